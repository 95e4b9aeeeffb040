"""Write the table of advice into docs/messages.md, from the rows of the package.

./fenicsx python3 docs/messages.py
"""

from __future__ import annotations

from pathlib import Path

from rigidfx.report.advice import ADVICE

PAGE = Path(__file__).parent / "messages.md"
HEAD = "| warning | bound | remedy |\n|---|---|---|\n"


def made(page: str) -> str:
    """The page with the table of today."""
    before, after = page.split(HEAD)
    rows = [f"| {name} | {row.bound:g} {row.of} | {row.remedy} |\n" for name, row in ADVICE.items()]
    return before + HEAD + "".join(rows) + after[after.index("\n\n") + 1 :]


if __name__ == "__main__":
    PAGE.write_text(made(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
