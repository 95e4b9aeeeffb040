"""Failures: an error that names the place, on all ranks, and nothing lost of what was before."""

from collections.abc import Iterator

from mpi4py import MPI

import rigidfx as rf

from .case import ANY, Run, both, case

SVK = rf.StVenantKirchhoff(E=1e5, nu=0.3, rho=100.0)


def _bar(material: rf.Material, *effects: rf.effects.Effect) -> rf.Scene:
    """A bar of 4 m that is fixed at its left end."""
    domain = rf.box((0, 0, 0), (4, 1, 1), (4, 1, 1))
    return rf.Scene(domain, material, [rf.Fixed("x0"), rf.Gravity((0.0, 0.0, -1.0)), *effects])


@case("failure", "cells are pushed inside out: a C = FᵀF that looks sound tells nothing of it")
def inversion(short: bool) -> Iterator[Run]:
    """An error that names the cell, its place and the time, after the step has been cut."""
    push = rf.PrescribedMotion("x1", displacement=lambda t: (-3.0 * t, 0.0, 0.0))
    criterion = rf.StrainRate(ANY, 0.1, patience=1)  # what is not beside a support
    yield from both(_bar(SVK, push), 0.05, 2.0, criterion, energy=1e-8, momentum=None, tangents=25,
                    fails=rf.InversionError,
                    says=("inside out", "cell 2 of", "X = (", "from t = 0."))  # fmt: skip


@case("failure", "a load that no equilibrium bears")
def step_that_cannot_converge(short: bool) -> Iterator[Run]:
    """An error that names the time and the node, after eight cuts; the steps before are whole."""
    pull = rf.Traction("x1", (1e20, 0.0, 0.0), since=0.25)
    criterion = rf.StrainRate(ANY, 0.1, patience=1)
    yield from both(_bar(SVK, pull), 0.05, 1.0, criterion, momentum=None, tangents=25,
                    fails=rf.StepError, says=("from t = 0.25 s", "X = ("))  # fmt: skip


@case("failure", "a load that neo-Hookean material bears, at a stretch whose energy overflows")
def load_beyond_all_bounds(short: bool) -> Iterator[Run]:
    """An error that names the time and the place; no number that is not finite is reported."""
    pull = rf.Traction("x1", (1e100, 0.0, 0.0), since=0.25)
    rubber = rf.NeoHooke(E=1e5, nu=0.3, rho=100.0)
    yield Run("flexible", _bar(rubber, pull), 0.05, 1.0, momentum=None,
              tangents=25, fails=rf.StepError, says=("from t = 0.25 s", "X = ("))  # fmt: skip


@case("failure", "a load that is NaN from some time on, on the last rank only")
def load_that_is_nan_on_one_rank(short: bool) -> Iterator[Run]:
    """All ranks raise the error that names the load and the time, instead of waiting."""
    last = MPI.COMM_WORLD.rank == MPI.COMM_WORLD.size - 1

    def value(t: float) -> tuple[float, float, float]:
        return (0.0, float("nan") if last and t > 0.5 else 1.0, 0.0)

    criterion = rf.StrainRate(ANY, 0.1, patience=1)
    scene = _bar(SVK, rf.Traction("x1", value))
    yield from both(scene, 0.05, 1.0, criterion, momentum=None, fails=rf.SceneError,
                    says=("Traction on 'x1'", "at t = 0.510566 s", "three finite"))  # fmt: skip
