"""Pictures of frames, maps and costmaps."""
