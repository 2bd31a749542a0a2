/* SPDX-License-Identifier: Apache-2.0
 *
 * The matrices of a step about a point, `linear.discretize.flow` with the same operations in the
 * same order: F = exp(A dt), and Q, what noise of density W adds.
 *
 * What stands before this text is series.c, and what that needs, and matrices.c; and generated from
 * the model: the functions jacobian and density, of x, u and p and of x and p.
 */

enum { DONE = 0, INFINITE_JACOBIAN = 1, OVERFLOW_WITHIN = 2 };

/* The number of halvings after which a step is short; -1 where the Jacobian is not finite. */
INLINE int halvings_of(const real *a, real dt)
{
    real sums[ORDER] = {0}, norm = 0;
    for (int k = 0; k < A_COUNT; k++)
        sums[A_COLUMN[k]] += fabs(a[k]);
    for (int j = 0; j < ORDER; j++)
        norm = sums[j] > norm || isnan(sums[j]) ? sums[j] : norm;
    const real reach = 2 * fabs(dt) * norm;
    if (!(reach < INFINITY))
        return -1;
    return reach > 1 ? (int)ceil(log2(reach)) : 0;
}

/* without with_F, F may remain unknown */
FAST static int flow(const real *x, const real *u, real dt, const real *p, real *F, real *Q,
                     int with_F)
{
    real a[A_COUNT + 1], w[W_COUNT + 1];
    jacobian(x, u, p, a);
    density(x, p, w);
    const int halvings = halvings_of(a, dt);
    if (halvings < 0)
        return INFINITE_JACOBIAN;
    const real h = ldexp(dt, -halvings);
    for (int k = 0; k < A_COUNT; k++)
        a[k] *= h;
    for (int k = 0; k < W_COUNT; k++)
        w[k] *= h;
    series(a, w, with_F || halvings, F, Q);
    for (int k = 0; k < halvings; k++) {
        real turned[ORDER * ORDER], half[ORDER * ORDER], more[ORDER * ORDER];
        for (int i = 0; i < ORDER; i++)
            for (int j = 0; j < ORDER; j++)
                turned[i * ORDER + j] = F[j * ORDER + i];
        dense_product(F, Q, half);
        dense_product(half, turned, more);
        for (int i = 0; i < ORDER; i++)
            for (int j = 0; j <= i; j++) {
                Q[j * ORDER + i] += (more[i * ORDER + j] + more[j * ORDER + i]) / 2;
                Q[i * ORDER + j] = Q[j * ORDER + i];
            }
        dense_product(F, F, half);
        memcpy(F, half, sizeof half);
    }
    return all_finite(Q) && (!halvings || all_finite(F)) ? DONE : OVERFLOW_WITHIN;
}
