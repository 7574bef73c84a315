"""``python -m jaxtat`` is the command ``jaxtat``."""

from .cli import main

if __name__ == "__main__":
    raise SystemExit(main())
