"""Frames from folders, data sets and cameras; one module for each kind."""
