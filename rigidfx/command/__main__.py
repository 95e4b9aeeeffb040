"""Run the command `rigidfx` where the package is not installed."""

from rigidfx.command.main import main

if __name__ == "__main__":
    main(prog="python3 -m rigidfx.command")
