"""Maps, costmaps and areas as files."""
