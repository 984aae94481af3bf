"""OpenGL through moderngl and EGL: colour, exact depth and classes."""
