"""Matrices of joints: arrays where they are small, sparse where they are not, the same numbers."""

import numpy as np
import pytest
from joints import PIN, bars
from mpi4py import MPI

import rigidfx as rf
from rigidfx.base import matrices

pytestmark = pytest.mark.skipif(MPI.COMM_WORLD.size > 1, reason="calls, and one rank's matrices")


def both(monkeypatch, make):
    """What is made of arrays, and what of sparse matrices."""
    small = make()
    monkeypatch.setattr(matrices, "SMALL", 0)
    return small, make()


@pytest.mark.filterwarnings("ignore:Body")
@pytest.mark.parametrize("parts", [(), ("A",)])
def test_machines_move_alike_with_both(monkeypatch, parts):
    """A hinge with a spring between bars, flexible or one rigid: places agree to rounding."""
    hinge = rf.Revolute(rf.MeanFace("a"), rf.MeanFace("b"), PIN, (0, 0, 1), name="hinge")
    spring = rf.JointSpring("hinge", 3.0, damping=0.1)
    effects = [*(rf.Rigid(name) for name in parts), hinge, spring]

    def ends():
        *_, last = rf.simulate(bars(*effects, n=3, joined=False), 0.01, 0.1)
        return last.state.positions(np.arange(len(last.state.X)))

    small, large = both(monkeypatch, ends)
    assert np.abs(small - large).max() <= 1e-10 * np.abs(small).max()
