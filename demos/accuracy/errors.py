"""Four errors of a history with respect to another."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from .runs import History
from .structure import Structure


def differences(structure: Structure, one: History, other: History) -> dict[str, float]:
    """The four errors of one history with respect to another, and the largest of them."""
    t = np.array(min(one["t"], other["t"], key=len))
    t = t[t >= structure.free - 1e-9]
    H, H_ref = (np.interp(t, h["t"], h["energy"]) for h in (one, other))
    ω_ref, δ_ref, z_ref = harmonic(structure, other)
    ω, _, z = harmonic(structure, one, (ω_ref, δ_ref))
    errors = {
        "energy": float(np.abs(H - H_ref).max() / H_ref.max()),
        "amplitude": abs(abs(z) / abs(z_ref) - 1),
        "phase": float(abs(np.angle(z / z_ref)) / (2 * np.pi)),
        "frequency": abs(ω / ω_ref - 1),
    }
    return {**errors, "error": max(errors.values())}


def harmonic(
    structure: Structure, history: History, near: tuple[float, float] | None = None
) -> tuple[float, float, complex]:
    """ω [rad/s], δ [1/s] and a - ib [m] of the fit, which begins near given ω and δ."""
    t, q = np.array(history["t"]), np.array(history["motion"])
    late = t >= structure.free - 1e-9
    t, q = t[late] - (structure.free + structure.t_end) / 2, q[late]
    if near is None:
        frequencies = np.fft.rfftfreq(16 * t.size, np.median(np.diff(t)))
        spectrum = np.abs(np.fft.rfft((q - q.mean()) * np.hanning(t.size), 16 * t.size))
        near = 2 * np.pi * frequencies[np.argmax(spectrum)], 0.0
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
