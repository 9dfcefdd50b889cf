"""``python -m lgprjax``: the command line where its script is not on the path."""

from lgprjax.cli import main

main()
