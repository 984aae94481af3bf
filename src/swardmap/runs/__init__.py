"""A whole recording, from source to files, in one process or many."""
