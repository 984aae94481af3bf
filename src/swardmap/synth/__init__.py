"""Scenes with exact truth: geometry, classes, depth and the map are all known."""
