"""What a real camera and a real stereo sensor make of an ideal view."""
