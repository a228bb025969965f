"""Example 1 of the paper, assembled with NumPy and SciPy, independently of the program.

Unknowns f[i, j], row-major, x first. Upwind in x; at the face x = 0 the hat interpolation of the
Hamiltonian-preserving scheme.
"""

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

LENGTH = 1.5  # the box is [-LENGTH, LENGTH] in x and v
V_LEFT, V_RIGHT = 0.2, 0.0


def axis(cells):
    """Centres and width."""
    width = 2 * LENGTH / cells
    return -LENGTH + width * (np.arange(cells) + 0.5), width


def initial(cells):
    """Two quarter discs, both moving to the step."""
    x, _ = axis(cells)
    X, V = np.meshgrid(x, x, indexing="ij")
    inside = (X**2 + V**2 < 1) & (((X <= 0) & (V > 0)) | ((X >= 0) & (V < 0)))
    return inside.astype(float).ravel()


def hat(velocity, centres, width):
    """Indices and weights of linear interpolation at `velocity`; off the grid is inflow, 0."""
    place = (velocity - centres[0]) / width
    lower = int(np.floor(place))
    pairs = [(lower, 1 - (place - lower)), (lower + 1, place - lower)]
    return [(k, w) for k, w in pairs if 0 <= k < len(centres) and w != 0]


def generator(cells):
    """A of f' = A f, CSR."""
    v, width = axis(cells)
    step = cells // 2  # the face x = 0 lies left of this cell
    assert cells % 2 == 0
    rows, columns, values = [], [], []

    def entry(i, j, k, l, value):
        rows.append(i * cells + j)
        columns.append(k * cells + l)
        values.append(value)

    for i in range(cells):
        for j in range(cells):
            rate = abs(v[j]) / width
            entry(i, j, i, j, -rate)
            ahead = 1 if v[j] > 0 else -1
            source = i - ahead
            if not 0 <= source < cells:
                continue
            if {source, i} != {step - 1, step}:
                entry(i, j, source, j, rate)
                continue
            # Energy is kept: v²/2 + V here = w²/2 + V behind the face.
            here, behind = (V_RIGHT, V_LEFT) if ahead > 0 else (V_LEFT, V_RIGHT)
            square = v[j]**2 + 2 * (here - behind)
            if square > 0:
                for l, weight in hat(ahead * np.sqrt(square), v, width):
                    entry(i, j, source, l, rate * weight)
            else:
                for l, weight in hat(-v[j], v, width):
                    entry(i, j, i, l, rate * weight)
    n = cells * cells
    return sp.csr_matrix((values, (rows, columns)), shape=(n, n))


def weights(A):
    """√π with Aᵀπ = 0 where columns grow: then sym(D A D⁻¹) has no positive eigenvalue."""
    growth = np.maximum(0, np.asarray(A.sum(axis=0)).ravel())
    return np.sqrt(1 + spla.spsolve(A.T.tocsc(), -growth))


class Modes:
    """Mode l obeys dw/dt = (−iμ_l S + K) w, w(0) = D f0; f(T) = D⁻¹ Re Σ weight_l w_l(T)."""
    def __init__(self, cells, plan):
        self.cells, self.time = cells, plan["time"]
        A = generator(cells)
        self.A, self.f0 = A, initial(cells)
        d = weights(A)
        self.d = d
        weighted = sp.diags(d) @ A @ sp.diags(1 / d)
        self.S = ((weighted + weighted.T) / 2).tocsr()
        self.K = ((weighted - weighted.T) / 2).tocsr()
        self.start = d * self.f0
        self.rate = -A.diagonal().min()
        # Any bound on the growth will do; the certificate of the weights is zero to round-off.
        self.growth = max(0.0, 0.5 * np.max((A.T @ d**2) / d**2))
        warp = plan["warp"]
        series, reading = warp["series"], warp["readings"][0]
        if reading["method"] != "point":
            raise ValueError(f"reading {reading['method']}: only a point is known here")
        c = np.array([complex(re, im) for re, im in series["coefficients"]])
        count = len(c)
        if count != warp["modes"]:
            raise ValueError(f"{count} coefficients, {warp['modes']} modes")
        self.mu = 2 * np.pi * np.arange(count) / series["period"]
        twice = np.full(count, 2.0)
        twice[0] = 1.0
        if series["alone"]:
            twice[-1] = 1.0
        p = reading["point"]
        self.weight = twice * c * np.exp(p + 1j * self.mu * p)
        # A mode's share of a tenth of the state's tolerance, as the program has it.
        share = warp["state_tolerance"] / (10 * count * np.abs(self.weight))
        self.tolerance = np.minimum(1.0, share)

    def hamiltonian(self, l):
        """H_l = μ_l S + iK, complex CSR."""
        return (self.mu[l] * self.S + 1j * self.K).tocsr()

    def recovered(self, total):
        """f(T) from Σ weight_l w_l(T)."""
        return total.real / self.d
