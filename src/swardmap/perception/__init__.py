"""What one view shows: cloud (Eq. 1), filters, ground, what stands on it."""
