"""Run the command line as ``python -m foucault``."""

from foucault.cli import main

if __name__ == "__main__":
    main()
