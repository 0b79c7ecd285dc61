"""What a step does to covariances, some numbers of a row at a time (see `vector`).

Of a symmetric matrix the lower triangle is worked out, in whole registers, and copied where a row is needed;
both triangles would be the same to the last bit. No sum is reordered, nor does one go across the lanes, so
that every build gives the same bits. `q` counts registers; rows are padded with zeros to pairs of them.
"""

from __future__ import annotations

from observer.kernels.vector import (
    LANES,
    load,
    load_at,
    load_of,
    mirror_block,
    none,
    registers,
    store,
    store_at,
)


def force_columns(P, G, columns, n_x, decay, d, half, H):
    """H_j = d∘P_j + ½ Σ_i P_ji G_i for the rows P_j of what acts through a column G_j; `half` is scratch."""
    n, width, forced = P.shape[0], P.shape[1], registers(n_x)
    for j in range(columns):
        for b in range(n_x + j + 1, n):
            P[n_x + j, b] = P[b, n_x + j]
    for j in range(columns):
        for i in range(columns):
            half[i] = 0.5 * P[n_x + j, n_x + i]
        for q in range(forced):
            own = load(decay, d, q) * load(P, n_x + j, q)
            for i in range(columns):
                own += half[i] * load(G, i, q)
            store(H, j, q, own)
        for q in range(forced, width // LANES):
            store(H, j, q, load(decay, d, q) * load(P, n_x + j, q))


def fade_and_force(P, H, G, columns, n_x, decay, Q, d):
    """P = (d dᵀ)∘P + Q + Σ_j (H_j G_jᵀ + G_j H_jᵀ), lower triangle; G is zero beyond its first n_x entries.

    Columns are taken two at a time, and where G is zero four: G and H have rows of zeros up to a number that
    four divides.
    """
    n, forced = P.shape[0], registers(n_x)
    for a in range(n_x):
        scale, end = decay[d, a], registers(a + 1)
        h0, g0, h1, g1 = H[0, a], G[0, a], H[1, a], G[1, a]
        for q in range(end):
            own = scale * load(decay, d, q) * load(P, a, q) + load_of(Q, d, a, q)
            two = (h0 * load(G, 0, q) + g0 * load(H, 0, q)) + (h1 * load(G, 1, q) + g1 * load(H, 1, q))
            store(P, a, q, own + two)
        for j in range(2, columns, 2):
            h0, g0, h1, g1 = H[j, a], G[j, a], H[j + 1, a], G[j + 1, a]
            for q in range(end):
                two = h0 * load(G, j, q) + g0 * load(H, j, q)
                two += h1 * load(G, j + 1, q) + g1 * load(H, j + 1, q)
                store(P, a, q, load(P, a, q) + two)
    for a in range(n_x, n):
        scale = decay[d, a]
        h0, h1, h2, h3 = H[0, a], H[1, a], H[2, a], H[3, a]
        for q in range(forced):
            own = scale * load(decay, d, q) * load(P, a, q) + load_of(Q, d, a, q)
            two, more = h0 * load(G, 0, q) + h1 * load(G, 1, q), h2 * load(G, 2, q) + h3 * load(G, 3, q)
            store(P, a, q, own + two + more)
        for j in range(4, columns, 4):
            h0, h1, h2, h3 = H[j, a], H[j + 1, a], H[j + 2, a], H[j + 3, a]
            for q in range(forced):
                two = h0 * load(G, j, q) + h1 * load(G, j + 1, q)
                more = h2 * load(G, j + 2, q) + h3 * load(G, j + 3, q)
                store(P, a, q, load(P, a, q) + two + more)
        for q in range(forced, registers(a + 1)):
            store(P, a, q, scale * load(decay, d, q) * load(P, a, q) + load_of(Q, d, a, q))


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


def sensor_covariances(C, n_x, P, g):
    """g_i = P c_i, of what each sensor sees of the first n_x states, (s, W); four sensors at a time."""
    s, width = g.shape[0], registers(P.shape[0])
    fours = s // 4 * 4
    for i in range(0, fours, 4):
        for q in range(0, width, 2):
            left0, left1, left2, left3 = none(), none(), none(), none()
            right0, right1, right2, right3 = none(), none(), none(), none()
            for a in range(n_x):
                left, right = load(P, a, q), load(P, a, q + 1)
                left0 += C[i, a] * left
                right0 += C[i, a] * right
                left1 += C[i + 1, a] * left
                right1 += C[i + 1, a] * right
                left2 += C[i + 2, a] * left
                right2 += C[i + 2, a] * right
                left3 += C[i + 3, a] * left
                right3 += C[i + 3, a] * right
            store_pair(g, i, q, left0, right0)
            store_pair(g, i + 1, q, left1, right1)
            store_pair(g, i + 2, q, left2, right2)
            store_pair(g, i + 3, q, left3, right3)
    for i in range(fours, s):
        for q in range(0, width, 2):
            left, right = none(), none()
            for a in range(n_x):
                left += C[i, a] * load(P, a, q)
                right += C[i, a] * load(P, a, q + 1)
            store_pair(g, i, q, left, right)


def store_pair(A, a, q, left, right):
    """Put two registers of row a back."""
    store(A, a, q, left)
    store(A, a, q + 1, right)


def innovation_covariances(g, C, S):
    """S_ji = g_jᵀ c_i for i ≥ j; `C` has the sensors' rows as columns, (n_x, S)."""
    s, width = S.shape[0], S.shape[1] // LANES
    for j in range(0, s - 1, 2):
        for q in range(j // LANES, width):
            one, other = none(), none()
            for a in range(C.shape[0]):
                one += g[j, a] * load(C, a, q)
                other += g[j + 1, a] * load(C, a, q)
            store(S, j, q, one)
            store(S, j + 1, q, other)
    for j in range(s // 2 * 2, s):
        for q in range(j // LANES, width):
            one = none()
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
    """c P cᵀ of the first `count` of the rows (n_x, W), which are columns here, from the lower triangle of P:
    2 Σ_a c_a (½ P_aa c_a + Σ_{b<a} P_ab c_b).
    """
    for q in range(registers(count)):
        whole = none()
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


def squared(value):
    """value²; a power would be rounded twice."""
    return value * value
