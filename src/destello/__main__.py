"""`python -m destello` is the `destello` command."""

from destello.cli import main

if __name__ == "__main__":
    main()
