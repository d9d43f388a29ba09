"""Sudden changes of the force channel: likelihood ratios over the last 0.05 … 1 s.

Over the last second of whitened blocks ρ = X θ + noise with θ ~ N(θ̂, P) as learnt before it. One more number
d along column j of X (a jump of δ_j, ν_j or β_j), x_j in the newest blocks, the window, and 0 before it, is
found and weighed with everything else free:
  S = x_jᵀ V⁻¹ (ρ − X θ̂),  N = x_jᵀ V⁻¹ x_j,  V = I + X P Xᵀ;  d̂ = S/N,  2 Λ = d̂ (2 S − d̂ N),
by Woodbury's identity from the sums XᵀX and Xᵀ(ρ − X θ̂) of the second and of the windows alone. So the blocks
before a window tell what the robot was like a moment ago: without them an unknown payload would pass for most
of a weak motor. What the jump leaves unexplained tells how large the noise of its window was: Λ is divided by
it where it is above 1.
"""

from __future__ import annotations

import numpy as np

from omnimj.physics.native import kernel

WINDOWS = (5, 10, 20, 50, 100)
"""Lengths [blocks]."""
LONGEST_WINDOW = WINDOWS[-1]
_LENGTHS = np.array(WINDOWS)

LIKELIHOOD, SIZE, DEVIATION, WINDOW = range(4)
"""Of one hypothesis: Λ [nats], d̂, its standard deviation, length of the window that says it [blocks]."""
SCORE = 4


@kernel
def likelihood_ratios(ring, filled, head, theta, precision, low, high, found):
    """Fills `found`, shape (2n+2, SCORE), with the best window of each jump: δ, ν, β.

    Args:
      ring: Whitened blocks, rows of [X (3 p) | ρ (3)], shape (LONGEST, 3 (p + 1)).
      filled: Blocks in it.
      head: Row of the newest block.
      theta: θ̂ before the window, shape (p,).
      precision: P⁻¹, shape (p, p).
      low: Least d per hypothesis, shape (2n+2,).
      high: Largest d, shape (2n+2,).
      found: Output.

    Returns:
      Σ of squares of ρ − X θ̂ over the longest window and over each, shape (windows,), per its 3 m numbers.
    """
    p, windows = theta.size, len(_LENGTHS)
    grams, pulls, squares = np.zeros((windows + 1, p, p)), np.zeros((windows + 1, p)), np.zeros(windows + 1)
    found[:, :] = 0.0
    ended = _window_sums(ring, filled, head, theta, grams, pulls, squares)
    whole, solved = precision.copy(), np.empty(p)
    for j in range(p):
        for q in range(j + 1):
            whole[j, q] += grams[windows, j, q]
            whole[q, j] = whole[j, q]
    chol = np.linalg.cholesky(whole)
    solve_lower(chol, pulls[windows], solved)
    for w in range(ended):
        _window_ratios(grams[w], pulls[w], squares[w], chol, solved, low, high, _LENGTHS[w], found)
    return squares[:windows] / (3.0 * _LENGTHS)


@kernel
def _window_sums(ring, filled, head, theta, grams, pulls, squares):
    """Fills XᵀX (below the diagonal), Xᵀ r and rᵀ r, r = ρ − X θ̂, of each window and, last, of all.

    Returns:
      How many windows end.
    """
    p, window, last = theta.size, 0, len(_LENGTHS)
    gram, pulled = grams[last], pulls[last]
    row = head
    for m in range(filled):
        block = ring[row]
        for k in range(3):
            away = block[3 * p + k]
            x = block[k * p : (k + 1) * p]
            for j in range(p):
                away -= x[j] * theta[j]
            squares[last] += away * away
            for j in range(p):
                if x[j] != 0.0:
                    pulled[j] += x[j] * away
                    for q in range(j + 1):
                        gram[j, q] += x[j] * x[q]
        row = row - 1 if row > 0 else ring.shape[0] - 1
        if window < last and m + 1 == _LENGTHS[window]:
            grams[window], pulls[window], squares[window] = gram, pulled, squares[last]
            window += 1
    return window


@kernel
def _window_ratios(gram, pulled, squares, chol, solved, low, high, blocks, found):
    """Every hypothesis at one window; keeps the better of this and what was found at shorter ones.

    Args:
      gram: XᵀX of the window, below the diagonal, shape (p, p).
      pulled: Xᵀ r of it, shape (p,).
      squares: rᵀ r of it.
      chol: Factor L of P⁻¹ + XᵀX of the whole second.
      solved: L⁻¹ Xᵀ r of the whole second.
      low: And `high`, of `likelihood_ratios`.
      blocks: Length of the window.
      found: Of `likelihood_ratios`.
    """
    p, length = pulled.size, float(blocks)
    beside, side, shift = np.empty(p), np.empty(p), np.empty(p)
    for h in range(low.size):
        column, score = gram[h, h], pulled[h]
        for j in range(p):
            beside[j] = gram[h, j] if j <= h else gram[j, h]
        solve_lower(chol, beside, side)
        for j in range(p):
            score -= side[j] * solved[j]
            column -= side[j] * side[j]
        if column <= 1e-6:
            continue
        size = min(max(score / column, low[h]), high[h])
        likelihood = 0.5 * size * (2.0 * score - size * column)
        if likelihood <= found[h, LIKELIHOOD]:
            continue
        for j in range(p):
            shift[j] = solved[j] - size * side[j]
        solve_lower_transposed(chol, shift)
        left = squares - size * (2.0 * pulled[h] - size * gram[h, h])
        for j in range(p):
            along = 0.0
            for q in range(j):
                along += gram[j, q] * shift[q]
            along = 2.0 * along + gram[j, j] * shift[j]
            left += shift[j] * (along - 2.0 * (pulled[j] - size * beside[j]))
        likelihood /= max(1.0, left / (3.0 * length))
        if likelihood > found[h, LIKELIHOOD]:
            found[h, LIKELIHOOD], found[h, SIZE] = likelihood, size
            found[h, DEVIATION], found[h, WINDOW] = column**-0.5, length


@kernel
def solve_lower_transposed(chol, right):
    """Lᵀ y = b by substitution, in place."""
    for j in range(right.size - 1, -1, -1):
        value = right[j]
        for q in range(j + 1, right.size):
            value -= chol[q, j] * right[q]
        right[j] = value / chol[j, j]


@kernel
def solve_lower(chol, right, out):
    """L y = b by substitution; `out` may be `right`."""
    for j in range(right.size):
        value = right[j]
        for q in range(j):
            value -= chol[j, q] * out[q]
        out[j] = value / chol[j, j]
