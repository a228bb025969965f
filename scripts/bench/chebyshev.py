"""Chebyshev series of exp(−iHT) with NumPy and SciPy, three ways.

Each takes a Modes and a list of modes, and yields w_l(T). The spectrum of H_l lies in
−μd ± √(1 + μ²) (d + γ), with d the largest rate and γ the growth. With H̃ = (H + μd)/h and
φ_k = (−i)^k T_k(H̃) w:

    φ_{k+1} = 2(−iH̃)φ_k + φ_{k−1},
    exp(−iHT) w = e^{iμdT} (J_0 φ_0 + 2 Σ J_k φ_k),   J_k = J_k(hT)
"""

import numpy as np
import scipy.sparse as sp
from scipy.linalg.blas import daxpy, zaxpy
from scipy.sparse import _sparsetools
from scipy.special import jv


def series(modes, l):
    """h, the coefficients as far as the mode's tolerance asks, and the phase."""
    h = np.sqrt(1 + modes.mu[l]**2) * (modes.rate + modes.growth)
    tau = h * modes.time
    terms = int(tau + 20 * tau**(1 / 3) + 60)
    J = jv(np.arange(terms), tau)
    rest = 2 * np.cumsum(np.abs(J)[::-1])[::-1]  # rest[k] = 2 Σ_{m ≥ k} |J_m|
    degree = int(np.argmax(rest <= modes.tolerance[l])) - 1
    coefficients = 2 * J[:degree + 1]
    coefficients[0] /= 2
    return h, coefficients, np.exp(1j * modes.mu[l] * modes.rate * modes.time)


def applications(modes, chosen):
    """Matrix applications for the modes chosen."""
    return sum(len(series(modes, l)[1]) - 1 for l in chosen)


def _scaled(modes, l, h, factor):
    """factor · (−iH̃_l), complex CSR."""
    shifted = modes.S + modes.rate * sp.identity(modes.S.shape[0], format="csr")
    return (factor / h * (modes.K - 1j * modes.mu[l] * shifted)).tocsr()


def plain(modes, chosen):
    """As one writes it down: complex CSR times vector, whole-array expressions."""
    for l in chosen:
        h, c, phase = series(modes, l)
        G = _scaled(modes, l, h, 1.0)
        before = modes.start.astype(complex)
        total = c[0] * before
        now = G @ before
        total = total + c[1] * now
        for k in range(2, len(c)):
            before, now = now, 2 * (G @ now) + before
            total = total + c[k] * now
        yield l, phase * total


def in_place(modes, chosen):
    """One mode at a time without temporaries: y += 2Gx by SciPy's CSR kernel, sums by BLAS."""
    n = len(modes.start)
    for l in chosen:
        h, c, phase = series(modes, l)
        G = _scaled(modes, l, h, 2.0)
        before = modes.start.astype(complex)
        now = 0.5 * (G @ before)
        total = c[0] * before
        zaxpy(now, total, a=c[1])
        for k in range(2, len(c)):
            _sparsetools.csr_matvec(n, n, G.indptr, G.indices, G.data, now, before)
            before, now = now, before
            zaxpy(now, total, a=c[k])
        yield l, phase * total


def batched(modes, chosen, lanes=8):
    """Several modes at once: S and K times arrays of 2·lanes columns, real parts first."""
    n = len(modes.start)
    S = (modes.S + modes.rate * sp.identity(n, format="csr")).tocsr()
    K = modes.K
    chosen = list(chosen)
    for first in range(0, len(chosen), lanes):
        batch = chosen[first:first + lanes]
        b = len(batch)
        found = [series(modes, l) for l in batch]
        h = np.array([f[0] for f in found])
        degree = max(len(f[1]) for f in found)
        c = np.zeros((degree, 2 * b))
        for m, f in enumerate(found):
            c[:len(f[1]), m] = c[:len(f[1]), b + m] = f[1]
        twice = np.concatenate([2 / h, 2 / h])
        # −iμS (x + iy) = μS y − iμS x
        across = np.concatenate([2 * modes.mu[batch] / h, -2 * modes.mu[batch] / h])
        before = np.zeros((n, 2 * b))
        before[:, :b] = modes.start[:, None]
        along, swapped, scratch = (np.empty_like(before) for _ in range(3))

        def add(x, y):
            """y += 2(−iH̃)x."""
            np.multiply(x, twice, out=along)
            np.multiply(x[:, b:], across[:b], out=swapped[:, :b])
            np.multiply(x[:, :b], across[b:], out=swapped[:, b:])
            _sparsetools.csr_matvecs(n, n, 2 * b, K.indptr, K.indices, K.data, along.ravel(),
                                     y.ravel())
            _sparsetools.csr_matvecs(n, n, 2 * b, S.indptr, S.indices, S.data, swapped.ravel(),
                                     y.ravel())

        now = np.zeros_like(before)
        add(before, now)
        now *= 0.5
        total = c[0] * before + c[1] * now
        flat = total.ravel()
        for k in range(2, degree):
            add(now, before)
            before, now = now, before
            np.multiply(now, c[k], out=scratch)
            daxpy(scratch.ravel(), flat)
        for m, l in enumerate(batch):
            yield l, found[m][2] * (total[:, m] + 1j * total[:, b + m])
