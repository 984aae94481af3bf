"""Whether what comes in can be trusted: cameras, poses, clocks, and what to do about it."""
