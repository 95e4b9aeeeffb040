"""A reader of the reports of a run."""

from __future__ import annotations

from rigidfx.report.report import Report

__all__ = ["Look"]


class Look:
    """Looks at each report for something that a user should know."""

    def follow(self, report: Report) -> None:
        """Look at a report. Collective.

        Args:
            report: The next one, that of the initial state first.
        """
        raise NotImplementedError

    def end(self) -> None:
        """Take note that the run has reached its end. Collective."""
