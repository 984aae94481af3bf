"""Teach by driving: labels from one drive over a lawn, a network that knows it, a gate."""
