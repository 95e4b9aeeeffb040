"""A run with parts that become rigid and, beside it, the same without, step by step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import rigidfx as rf

from .reports import line_of
from .start import say

SAME = 1e-9  # relative difference of times that are one


class Pair:
    """Two runs that go on together, so that a change of the machine's speed hits them alike.

    It is a context, at the end of which both are freed, and iterates over the reports of the
    adaptive run; its freezes and releases are printed.

    Attributes:
        adaptive: Reports so far.
        flexible: Those of the fully flexible run, which is never behind; none if not wanted.
    """

    def __init__(
        self,
        scene: rf.Scene,
        dt: float | Mapping[float, float],
        t_end: float,
        rigidify: rf.StrainRate,
        compare: bool = True,
        beside: rf.StrainRate | None = None,
    ) -> None:
        """Set the runs up, as of `rf.simulate`; without `compare` there is one only.

        One of tolerance zero in `beside` has the strain rates of the flexible run measured.
        """
        self.adaptive: list[rf.Report] = []
        self.flexible: list[rf.Report] = []
        self._ahead = rf.simulate(scene, dt, t_end, rigidify=rigidify, progress=True)
        self._beside = None
        if compare:
            self._beside = rf.simulate(scene, dt, t_end, rigidify=beside, progress=False)

    def __enter__(self) -> Pair:
        return self

    def __exit__(self, *_: object) -> None:
        self._ahead.close()
        if self._beside is not None:
            self._beside.close()

    def __iter__(self) -> Iterator[rf.Report]:
        for report in self._ahead:
            self.adaptive.append(report)
            # A step that was cut has reports at times that the other run has not.
            while self._beside is not None and self._is_behind(report.t):
                self.flexible.append(next(self._beside))
            for event in report.events:
                say(line_of(event))
            yield report

    def matched(self) -> list[tuple[rf.Report, rf.Report]]:
        """Reports of both runs at the same times: those of cut steps are in one only."""
        out, ahead, beside = [], iter(self.adaptive), iter(self.flexible)
        a, b = next(ahead, None), next(beside, None)
        while a is not None and b is not None:
            if abs(a.t - b.t) <= SAME * max(a.t, b.t):
                out.append((a, b))
                a, b = next(ahead, None), next(beside, None)
            elif a.t < b.t:
                a = next(ahead, None)
            else:
                b = next(beside, None)
        return out

    def _is_behind(self, t: float) -> bool:
        return not self.flexible or self.flexible[-1].t < t * (1 - SAME)
