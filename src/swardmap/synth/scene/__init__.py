"""Gardens from a seed: the ground, what stands and moves on it, and the lanes of a mower."""
