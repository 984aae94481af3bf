"""Labelled clouds as files."""
