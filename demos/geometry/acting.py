"""What acts on a geometry of one's own: supports, loads, gravity, damping."""

from __future__ import annotations

from argparse import Namespace

import rigidfx as rf


def supports_and_loads(options: Namespace, until: float) -> list[rf.effects.Effect]:
    """The effects that the options name; loads end at a time [s].

    A load is a total force over the area of its facets.
    """
    found: list = [rf.NumericalDamping(options.damping)] if options.damping else []
    for text in options.hold:
        name, _, components = text.partition(":")
        found.append(rf.Fixed(name, components or "xyz"))
    for name, force in options.load:
        found.append(rf.Traction(name, tuple(force), total=True, until=until))
    if options.gravity:
        found.append(rf.Gravity(tuple(options.gravity)))
    return found
