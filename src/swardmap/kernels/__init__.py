"""The compiled twins of the hot loops; nothing else imports numba.

Every kernel has a NumPy twin that says the same thing slowly, and a test that holds the two equal.
Kernels are compiled on first use and cached on disk; fast-math is off, so that they round as NumPy does.
"""
