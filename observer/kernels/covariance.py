"""Steps and corrections of covariances, some numbers of a row at a time (see `vector`).

The lower triangle of a symmetric matrix is computed, in whole registers, and copied if a row is needed. Both
triangles would be the same to the last bit. No sum is reordered or crosses the lanes. Every build therefore
gives the same bits. The index `q` counts registers; rows are padded with zeros to pairs of them.
"""

from __future__ import annotations

from observer.kernels.vector import (
    LANES,
    load,
    load_at,
    load_of,
    mirror_block,
    registers,
    store,
    store_at,
    zero_lanes,
)


def force_columns(P, G, columns, n_x, t, d, work):
    """H_j = d∘P_j + ½ Σ_i P_ji G_i for the rows P_j of states that act through a column G_j."""
    n, width, forced = P.shape[0], P.shape[1], registers(n_x)
    for j in range(columns):
        for b in range(n_x + j + 1, n):
            P[n_x + j, b] = P[b, n_x + j]
    for j in range(columns):
        for i in range(columns):
            work.half[i] = 0.5 * P[n_x + j, n_x + i]
        for q in range(forced):
            row = load(t.decay, d, q) * load(P, n_x + j, q)
            for i in range(columns):
                row += work.half[i] * load(G, i, q)
            store(work.H, j, q, row)
        for q in range(forced, width // LANES):
            store(work.H, j, q, load(t.decay, d, q) * load(P, n_x + j, q))


def fade_and_force(P, H, G, columns, n_x, t, d):
    """P = (d dᵀ)∘P + Q + Σ_j (H_j G_jᵀ + G_j H_jᵀ), lower triangle; G is zero beyond n_x entries.

    Four rows are taken at a time, in whole pairs of registers.
    """
    fours, forced = P.shape[0] // 4 * 4, registers(n_x)
    for a in range(0, fours, 4):
        for q in range(0, registers(a + 4), 2):
            left, right = load(t.decay, d, q), load(t.decay, d, q + 1)
            left0 = t.decay[d, a] * left * load(P, a, q) + load_of(t.noise, d, a, q)
            right0 = t.decay[d, a] * right * load(P, a, q + 1) + load_of(t.noise, d, a, q + 1)
            left1 = t.decay[d, a + 1] * left * load(P, a + 1, q) + load_of(t.noise, d, a + 1, q)
            right1 = t.decay[d, a + 1] * right * load(P, a + 1, q + 1) + load_of(t.noise, d, a + 1, q + 1)
            left2 = t.decay[d, a + 2] * left * load(P, a + 2, q) + load_of(t.noise, d, a + 2, q)
            right2 = t.decay[d, a + 2] * right * load(P, a + 2, q + 1) + load_of(t.noise, d, a + 2, q + 1)
            left3 = t.decay[d, a + 3] * left * load(P, a + 3, q) + load_of(t.noise, d, a + 3, q)
            right3 = t.decay[d, a + 3] * right * load(P, a + 3, q + 1) + load_of(t.noise, d, a + 3, q + 1)
            for j in range(columns if q < forced else 0):
                left, right = load(G, j, q), load(G, j, q + 1)
                left0 += H[j, a] * left
                right0 += H[j, a] * right
                left1 += H[j, a + 1] * left
                right1 += H[j, a + 1] * right
                left2 += H[j, a + 2] * left
                right2 += H[j, a + 2] * right
                left3 += H[j, a + 3] * left
                right3 += H[j, a + 3] * right
            for j in range(columns if a < n_x else 0):
                left, right = load(H, j, q), load(H, j, q + 1)
                left0 += G[j, a] * left
                right0 += G[j, a] * right
                left1 += G[j, a + 1] * left
                right1 += G[j, a + 1] * right
                left2 += G[j, a + 2] * left
                right2 += G[j, a + 2] * right
                left3 += G[j, a + 3] * left
                right3 += G[j, a + 3] * right
            store_pair(P, a, q, left0, right0)
            store_pair(P, a + 1, q, left1, right1)
            store_pair(P, a + 2, q, left2, right2)
            store_pair(P, a + 3, q, left3, right3)
    for a in range(fours, P.shape[0]):
        for q in range(registers(a + 1)):
            left0 = t.decay[d, a] * load(t.decay, d, q) * load(P, a, q) + load_of(t.noise, d, a, q)
            for j in range(columns):
                left0 += H[j, a] * load(G, j, q) + G[j, a] * load(H, j, q)
            store(P, a, q, left0)


def mirror(P):
    """Copy the lower triangle to the upper."""
    whole = P.shape[0] // LANES
    for p in range(whole):
        for q in range(p):
            mirror_block(P, p, q)
        for a in range(p * LANES, (p + 1) * LANES):
            for b in range(p * LANES, a):
                P[b, a] = P[a, b]
    for a in range(whole * LANES, P.shape[0]):
        for b in range(a):
            P[b, a] = P[a, b]


def subtract_seen(read, C, x):
    """read -= C x for all sensors; `C` has their rows as columns, (n_x, S)."""
    for q in range(len(read) // LANES):
        rest = load_at(read, q)
        for a in range(C.shape[0]):
            rest -= x[a] * load(C, a, q)
        store_at(read, q, rest)


def multiply_rows(A, B, inner, columns, lower, out):
    """out_i = Σ_a A_ia B_a over the first `inner` rows of B, for every row of `out`, four at a time.

    It computes `columns` columns, or with `lower` those up to the diagonal, in whole pairs of registers.
    """
    fours = out.shape[0] // 4 * 4
    for i in range(0, fours, 4):
        for q in range(0, registers(min(columns, i + 4) if lower else columns), 2):
            left0, left1, left2, left3 = zero_lanes(), zero_lanes(), zero_lanes(), zero_lanes()
            right0, right1, right2, right3 = zero_lanes(), zero_lanes(), zero_lanes(), zero_lanes()
            for a in range(inner):
                left, right = load(B, a, q), load(B, a, q + 1)
                left0 += A[i, a] * left
                right0 += A[i, a] * right
                left1 += A[i + 1, a] * left
                right1 += A[i + 1, a] * right
                left2 += A[i + 2, a] * left
                right2 += A[i + 2, a] * right
                left3 += A[i + 3, a] * left
                right3 += A[i + 3, a] * right
            store_pair(out, i, q, left0, right0)
            store_pair(out, i + 1, q, left1, right1)
            store_pair(out, i + 2, q, left2, right2)
            store_pair(out, i + 3, q, left3, right3)
    for i in range(fours, out.shape[0]):
        for q in range(0, registers(min(columns, i + 1) if lower else columns), 2):
            left, right = zero_lanes(), zero_lanes()
            for a in range(inner):
                left += A[i, a] * load(B, a, q)
                right += A[i, a] * load(B, a, q + 1)
            store_pair(out, i, q, left, right)


def take_along(M, MT, n_x, P, scratch):
    """P ← T P Tᵀ with T = M on the first n_x states and the identity on the others.

    `MT` is Mᵀ, and `scratch` has the size of P. P is complete before; afterwards its lower triangle is valid.
    """
    multiply_rows(P, MT, n_x, n_x, False, scratch)
    multiply_rows(M, scratch, n_x, n_x, True, P[:n_x])
    for a in range(n_x, P.shape[0]):
        for b in range(n_x):
            P[a, b] = scratch[a, b]


def store_pair(A, a, q, left, right):
    """Put two registers of row a back."""
    store(A, a, q, left)
    store(A, a, q + 1, right)


def innovation_covariances(g, C, S):
    """S_ji = g_jᵀ c_i for i ≥ j; `C` has the sensors' rows as columns, (n_x, S)."""
    s, width = S.shape[0], S.shape[1] // LANES
    for j in range(0, s - 1, 2):
        for q in range(j // LANES, width):
            one, other = zero_lanes(), zero_lanes()
            for a in range(C.shape[0]):
                one += g[j, a] * load(C, a, q)
                other += g[j + 1, a] * load(C, a, q)
            store(S, j, q, one)
            store(S, j + 1, q, other)
    for j in range(s // 2 * 2, s):
        for q in range(j // LANES, width):
            one = zero_lanes()
            for a in range(C.shape[0]):
                one += g[j, a] * load(C, a, q)
            store(S, j, q, one)


def whiten(L, g, count, i, W):
    """Row `count` of W = L⁻¹ [c_i P]; L holds the inverses of its diagonal."""
    inverse = L[count, count]
    for q in range(0, W.shape[1] // LANES, 2):
        left, right = inverse * load(g, i, q), inverse * load(g, i, q + 1)
        for j in range(count):
            shared = inverse * L[count, j]
            left -= shared * load(W, j, q)
            right -= shared * load(W, j, q + 1)
        store_pair(W, count, q, left, right)


def subtract_squares(W, count, P):
    """P -= Wᵀ W over the first rows of W, four of them at a time; the lower triangle."""
    fours = count // 4 * 4
    for a in range(P.shape[0]):
        end = registers(a + 1)
        for j in range(0, fours, 4):
            w0, w1, w2, w3 = W[j, a], W[j + 1, a], W[j + 2, a], W[j + 3, a]
            for q in range(end):
                two = w0 * load(W, j, q) + w1 * load(W, j + 1, q)
                two += w2 * load(W, j + 2, q) + w3 * load(W, j + 3, q)
                store(P, a, q, load(P, a, q) - two)
        for j in range(fours, count):
            w0 = W[j, a]
            for q in range(end):
                store(P, a, q, load(P, a, q) - w0 * load(W, j, q))


def squares_of_rows(P, rows, count, total):
    """Write c P cᵀ of the first `count` of the rows (n_x, W), stored as columns.

    It uses the lower triangle of P: 2 Σ_a c_a (½ P_aa c_a + Σ_{b<a} P_ab c_b).
    """
    for q in range(registers(count)):
        whole = zero_lanes()
        for a in range(rows.shape[0]):
            half = sum_scaled(0.5 * P[a, a] * load(rows, a, q), rows, q, P, a, a)
            whole += 2.0 * load(rows, a, q) * half
        store_at(total, q, whole)


def sum_scaled(total, rows, q, weights, w, count):
    """total + Σ_a weights_wa rows_a over the first `count` rows, in sums of four (see `add_scaled`)."""
    fours = count // 4 * 4
    for a in range(0, fours, 4):
        two = weights[w, a] * load(rows, a, q) + weights[w, a + 1] * load(rows, a + 1, q)
        total += two + (weights[w, a + 2] * load(rows, a + 2, q) + weights[w, a + 3] * load(rows, a + 3, q))
    for a in range(fours, count):
        total += weights[w, a] * load(rows, a, q)
    return total


def add_scaled(target, rows, weights, count):
    """target += Σ_a weights_a · rows_a over the first `count` rows, in sums of four, two at a time."""
    pairs, whole = count // 8 * 8, count // 4 * 4
    for a in range(0, pairs, 8):
        w0, w1, w2, w3 = weights[a], weights[a + 1], weights[a + 2], weights[a + 3]
        w4, w5, w6, w7 = weights[a + 4], weights[a + 5], weights[a + 6], weights[a + 7]
        for b in range(len(target)):
            four = (w0 * rows[a, b] + w1 * rows[a + 1, b]) + (w2 * rows[a + 2, b] + w3 * rows[a + 3, b])
            next_four = (w4 * rows[a + 4, b] + w5 * rows[a + 5, b]) + (
                w6 * rows[a + 6, b] + w7 * rows[a + 7, b]
            )
            target[b] = (target[b] + four) + next_four
    for a in range(pairs, whole, 4):
        w0, w1, w2, w3 = weights[a], weights[a + 1], weights[a + 2], weights[a + 3]
        for b in range(len(target)):
            target[b] += (w0 * rows[a, b] + w1 * rows[a + 1, b]) + (w2 * rows[a + 2, b] + w3 * rows[a + 3, b])
    for a in range(whole, count):
        w0 = weights[a]
        for b in range(len(target)):
            target[b] += w0 * rows[a, b]


def add_row(target, weight, row):
    """target += weight · row."""
    for q in range(len(target)):
        target[q] += weight * row[q]


def squared(value):
    """value²; a power would be rounded twice."""
    return value * value
