"""All shadows of a run, as those see them who ask what rigid parts carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rigidfx.shadow.body_forces import BodyForces
from rigidfx.shadow.recovery import Carried, Recovery
from rigidfx.shadow.shadow import Shadow

__all__ = ["Shadows"]

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int32]


@dataclass(frozen=True)
class Shadows:
    """The shadows of a run.

    Attributes:
        free: Of bodies that move freely; their forces alone where the error motion decides.
        held: Of parts named rigid while supports hold them; None if none ever do.
        recovery: What parts named rigid strain by in the whole structure.
    """

    free: Shadow | BodyForces
    held: Shadow | None
    recovery: Recovery

    def recovered(self) -> Carried:
        """K⁺ρ of the last step in space. Collective.

        Parts named rigid are what they would be in the whole structure; see `Recovery`.
        """
        (u, cells), loaded = self.free.recovered(), self.free.loaded()
        if self.held is not None:
            more, others = self.held.recovered()
            u, cells = u + more, np.concatenate([cells, others])
            loaded += self.held.loaded()
        return Carried(u, cells, self.recovery.recover(u, loaded, self.free.dt))

    def share(self, name: str) -> float:
        """What a part named rigid withholds in the whole structure, over that by its shadow.

        Collective; takes a tangent of all of it, and its factors.

        Args:
            name: The part.
        """
        held = None if self.held is None else self.held.share(name)
        found = self.free.share(name) if held is None else held
        return 1.0 if found is None else found

    def remember(self) -> None:
        """Have what is known of the last step outlast its equations. Collective."""
        if self.held is not None:
            self.held.remember()

    def forget(self) -> None:
        """Have nothing known of the last step of held parts, which an error has ended."""
        if self.held is not None:
            self.held.forget()

    def destroy(self) -> None:
        """Free the PETSc objects; what parts carry may still be asked for. Collective."""
        self.recovery.destroy()
        self.free.destroy()
        if self.held is not None:
            self.held.destroy()
