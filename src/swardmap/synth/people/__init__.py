"""Bodies in any pose, clothed, standing still or walking."""
