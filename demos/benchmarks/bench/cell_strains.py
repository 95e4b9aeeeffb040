"""Strains of cells by the motion of their nodes; on one rank."""

from __future__ import annotations

import basix
import numpy as np

import rigidfx as rf

__all__ = ["CellStrains"]


class CellStrains:
    """Green strains at the points of a rule of second order in each cell."""

    def __init__(self, scene: rf.Scene) -> None:
        """Tabulate gradients of the shape functions of a scene's space."""
        element, X = scene.space.element.basix_element, scene.space.tabulate_dof_coordinates()
        points, weights = basix.make_quadrature(element.cell_type, 2)
        by_point = np.moveaxis(element.tabulate(1, points)[1:, :, :, 0], 0, 2)
        self._nodes = scene.space.dofmap.list
        J = np.einsum("cna,qnb->cqab", X[self._nodes], by_point)
        self._gradients = np.einsum("qnb,cqba->cqna", by_point, np.linalg.inv(J))
        volumes = weights * np.abs(np.linalg.det(J))
        self._shares = volumes / volumes.sum(axis=1, keepdims=True)

    def of(self, places: np.ndarray) -> np.ndarray:
        """E for places of nodes, shape (nodes, 3) [m]; of shape (cells, points, 3, 3)."""
        F = np.einsum("cna,cqnb->cqab", places[self._nodes], self._gradients)
        return 0.5 * (np.einsum("cqka,cqkb->cqab", F, F) - np.eye(3))

    def sizes(self, E: np.ndarray) -> np.ndarray:
        """Root of the mean of E:E over each cell."""
        return np.sqrt(np.einsum("cqab,cqab,cq->c", E, E, self._shares))
