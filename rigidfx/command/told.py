"""Errors and warnings of rigidfx as messages of the command, in the words of its options.

Messages name arguments and classes of Python, as they are written for scripts. Where the command
has an option, this stands in their place; a closing sentence names the others as those of Python.
"""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

from rigidfx import effects
from rigidfx.base.errors import RigidfxError, RigidfxWarning, SceneError
from rigidfx.base.warning import worded
from rigidfx.command.options import RankParser

__all__ = ["WORDS", "in_options", "told"]

# Patterns, in order, and the command's words. A name that a user has given stands in quotes, and
# stays; patterns with quotes of their own come first.
WORDS = (
    (r"order=2 with mass='consistent'", "--order 2"),
    (r"mass='consistent', or order=2 with hexahedra", "--order 2"),
    (r"\(size; in read_cad also per_circle=(\d+)", r"(--size; of CAD also --per-circle \1"),
    (r"read_inp\(…, (\w+)=('?)([\w-]+)\2\)", r"\1=\2\3\2"),
    (r"\bcorners=True", "--corners"),
    (r"\bencoding='([\w-]+)'", r"--encoding \1"),
    (r"\belement='(\w+)'", r"--element \1"),
    (r"\bcurved ones \(order=2\)", "curved ones (--curved)"),
    (r"\border=(\d)", r"--order \1"),
    (r"\bper_circle=(\d+)", r"--per-circle \1"),
    (r"glue=True of read_cad, ", ""),  # the command glues
    (r"\bscale=([\d.e-]+) where a mesh is read", r"--scale \1"),
    (r"\((size|scale)\)", r"(--\1)"),
    (r"since, until, the times of its Table, and t_end", "--until and --t-end"),
    (r"a larger tol or kappa", "a larger --tol"),
    (r"a (smaller|larger) tolerance", r"a \1 --tol"),
    (r"a longer window", "a longer --window"),
    (r"Take window ≥ ([\d.e-]+), or 'auto'", r"Take --window \1, or auto"),
    (r"\(rf\.periods\)", "(--describe)"),
    (r"\bScene\.describe\(\)", "--describe"),
    (r"\brf\.static\b", "--static"),
    (r"\bt_end\b", "--t-end"),
    (r"\bdt\b(?= [=≥≤]|\.)", "--dt"),
    (r"\bΔt(?=,? ≤| and|\.)", "Δt (--dt)"),
    (r"^Recorder:", "--out:"),
    (r"^StrainRate: (tol|window)\b", r"--\1"),
    (r"\bNumericalDamping\b", "--damping"),
    (r"\bTraction\b", "--load"),
    (r"\bFixed\b", "--hold"),
    (r"\bGravity\b", "--gravity"),
)
QUOTED = r"(?<!\w)('[^'\n]*')(?!\w)"
FUNCTIONS = "read_cad|read_geo|read_inp|read_msh|simulate|static|modes"
OWNER = re.compile(rf"^(?:gmsh: )?(?:{FUNCTIONS}|[A-Z]\w+): ")
CLASSES = "|".join([*effects.__all__, "Accuracy", "NeoHooke", "Release", "StepControl"])
OTHERS = re.compile(
    rf"\brf\.\w+|\b(?:{CLASSES})\b|\bwith_\w+|\b[a-z]\w*=(?!=)|\((?:never|patience|leave_out\?)\)"
)


def in_options(message: str) -> str:
    """A message in the words of the command.

    Args:
        message: One in the words of Python.
    """
    message, *table = message.split("\n", 1)  # of what there is, in words of its own
    for pattern, words in WORDS:
        if "'" in pattern:
            message = re.sub(pattern, words, message)
    parts = re.split(QUOTED, message)
    own = parts[::2]  # what stands between names
    for pattern, words in WORDS:
        whole = own[:1] if pattern.startswith("^") else own
        own[: len(whole)] = [re.sub(pattern, words, part) for part in whole]
    own[0] = OWNER.sub("", own[0])
    others = [found.strip("()=?") for part in own for found in OTHERS.findall(part)]
    parts[::2] = own
    text = "".join(parts)
    if others:
        text += f" (Only scripts in Python have {', '.join(dict.fromkeys(others))}.)"
    return "\n".join([text, *table])


@contextmanager
def told(parser: RankParser) -> Iterator[None]:
    """Stop all ranks over an error of rigidfx, which all have: a message instead of a traceback.

    Warnings are lines, without the place in a script that Python shows. Both name options.
    """
    try:
        with worded(in_options), _in_lines():
            yield
    except SceneError as error:  # of what is asked for
        parser.error(in_options(str(error)))
    except RigidfxError as error:  # of the run
        parser.exit(1, f"{parser.prog}: {type(error).__name__}: {in_options(str(error))}\n")


@contextmanager
def _in_lines() -> Iterator[None]:
    """Show warnings of rigidfx as lines, above a bar of progress."""
    before = warnings.showwarning

    def show(message: Any, category: type[Warning], *place: Any, **how: Any) -> None:
        if issubclass(category, RigidfxWarning):
            tqdm.write(f"rigidfx: warning: {in_options(str(message))}", file=sys.stderr)
        else:
            before(message, category, *place, **how)

    warnings.showwarning = show
    try:
        yield
    finally:
        warnings.showwarning = before
