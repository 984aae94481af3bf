"""`python -m swardmap` is `swardmap`."""

from swardmap.cli import main

main()
