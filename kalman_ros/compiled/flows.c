/* SPDX-License-Identifier: Apache-2.0
 *
 * The matrices of steps of several members in continuous time. What stands before this text is
 * lanes.c with series.c behind it, and flow.c.
 */

/* `flow` of LANES members at once; 0 where one is not that simple, or lanes hold one alone. */
FAST static int flows(const double *x, const double *u, double dt, const double **p, double *F,
                      double *Q, int with_F)
{
    if (LANES == 1)
        return 0;
    lanes a[A_COUNT + 1], w[W_COUNT + 1], all_F[N * N], all_Q[N * N];
    for (int l = 0; l < LANES; l++) {
        double one[A_COUNT + 1], noise[W_COUNT + 1];
        jacobian(x + l * N, u + l * M, p[l], one);
        density(x + l * N, p[l], noise);
        if (halvings_of(one, dt))
            return 0;
        for (int k = 0; k < A_COUNT; k++)
            LANE(a[k], l) = one[k] * dt;
        for (int k = 0; k < W_COUNT; k++)
            LANE(w[k], l) = noise[k] * dt;
    }
    series_of_lanes(a, w, with_F, all_F, all_Q);
    for (int l = 0; l < LANES; l++, F += N * N, Q += N * N) {
        for (int i = 0; i < N * N; i++)
            F[i] = LANE(all_F[i], l), Q[i] = LANE(all_Q[i], l);
        if (!all_finite(Q))
            return 0;
    }
    return 1;
}
