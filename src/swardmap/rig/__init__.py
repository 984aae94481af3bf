"""Several cameras on one robot, and which of them are asked."""
