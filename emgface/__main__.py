"""The command line as ``python -m emgface``."""

from emgface.cli import main

if __name__ == "__main__":
    main()
