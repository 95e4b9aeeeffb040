"""Four errors of a history with respect to another."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

from .runs import History
from .structure import Structure


def differences(structure: Structure, one: History, other: History) -> dict[str, float]:
    """The four errors of one history with respect to another, and the largest of them.

    `distance` is none of the four: the largest of the probe that budgets are of, over what these
    are parts of.
    """
    every = np.array(min(one["t"], other["t"], key=len))
    t = every[every >= structure.free - 1e-9]
    free = structure.free
    H, H_ref = (_at(t, h, "energy", free) for h in (one, other))
    q, q_ref = (_at(t, h, "motion", free) for h in (one, other))
    ω_ref, δ_ref, z_ref = harmonic(structure, t, q_ref, _guess(structure, other))
    ω, _, z = harmonic(structure, t, q, (ω_ref, δ_ref))
    errors = {
        "energy": float(np.abs(H - H_ref).max() / H_ref.max()),
        "amplitude": abs(abs(z) / abs(z_ref) - 1),
        "phase": float(abs(np.angle(z / z_ref)) / (2 * np.pi)),
        "frequency": abs(ω / ω_ref - 1),
    }
    path, exact = (np.stack([_at(every, h, axis) for axis in "xyz"]) for h in (one, other))
    size = structure.of or np.linalg.norm(exact - exact[:, :1], axis=0).max()
    distance = float(np.linalg.norm(path - exact, axis=0).max() / size)
    return {**errors, "error": max(errors.values()), "distance": distance}


def _at(t: np.ndarray, history: History, name: str, since: float = 0.0) -> np.ndarray:
    """A column at some times [s], by cubics between the steps since a time [s]."""
    late = np.array(history["t"]) >= since - 1e-9
    return np.asarray(CubicSpline(*(np.array(history[k])[late] for k in ("t", name)))(t))


def _guess(structure: Structure, history: History) -> tuple[float, float]:
    """The ω of the largest line of a spectrum of evenly spaced times [rad/s], and no δ."""
    t = np.linspace(structure.free, structure.t_end, 1000)
    q = _at(t, history, "motion", structure.free)
    frequencies = np.fft.rfftfreq(16 * t.size, t[1] - t[0])
    spectrum = np.abs(np.fft.rfft((q - q.mean()) * np.hanning(t.size), 16 * t.size))
    return 2 * np.pi * float(frequencies[np.argmax(spectrum)]), 0.0


def harmonic(
    structure: Structure, t: np.ndarray, q: np.ndarray, near: tuple[float, float]
) -> tuple[float, float, complex]:
    """ω [rad/s], δ [1/s] and a - ib [m] of the fit to q(t), which begins near given ω and δ."""
    t = t - (structure.free + structure.t_end) / 2
    scale = near[0]

    def basis(shape: np.ndarray) -> np.ndarray:
        ω, δ = scale * shape
        decay = np.exp(-δ * t)
        return np.stack([decay * np.cos(ω * t), decay * np.sin(ω * t), np.ones_like(t)], axis=1)

    def misfit(shape: np.ndarray) -> np.ndarray:
        columns = basis(shape)
        return (columns @ np.linalg.lstsq(columns, q, rcond=None)[0] - q) / np.abs(q).max()

    best = least_squares(misfit, np.array(near) / scale, xtol=1e-14, ftol=1e-14, gtol=1e-14).x
    a, b, _ = np.linalg.lstsq(basis(best), q, rcond=None)[0]
    return float(scale * best[0]), float(scale * best[1]), complex(a, -b)
