/* SPDX-License-Identifier: Apache-2.0
 *
 * Steps of a model in discrete time, and their linearisation: `core.DiscreteModel` for one state,
 * with the same operations in the same order.
 *
 * What stands before this text is matrices.c, and generated from the model: N states, M inputs,
 * MOST_PERIODS and TOLERANCE; the functions period, substep, which is one period, wrap, density,
 * what noise adds in a period, and slope, with F_ROW, F_COLUMN and F_COUNT of its F.
 */

enum { DONE = 0, NO_PERIODS = 1, OVERFLOW_WITHIN = 2 };
#define F_BY_FLOW 1
/* as `flow` of several members at once: they follow one after the other */
#define flows(x, u, dt, p, F, Q, with_F) 0
#define step_once advance

/* The number of periods in dt; -1 where it is not whole. */
static long periods(real dt, const real *p)
{
    real one;
    period(p, &one);
    const real count = floor(dt / one + (real)0.5);
    const int whole = fabs(dt / one - count) <= TOLERANCE;
    return whole && count <= MOST_PERIODS ? (long)count : -1; /* a negative one is refused, too */
}

/* One period, which may begin and end in the same place */
static void advance_once(const real *x, const real *u, const real *p, real *moved)
{
    real next[N];
    substep(x, u, p, next);
    wrap(next, moved);
}

static void advance(const real *x, const real *u, real dt, real max_step,
                    const real *p, real *moved, real *F)
{
    const long count = periods(dt, p);
    (void)max_step, (void)F;
    for (int i = 0; i < N; i++)
        moved[i] = count < 0 ? NAN : x[i];
    for (long k = 0; k < count; k++)
        advance_once(moved, u, p, moved);
}

/* F and Q of a step, along its way */
static int flow(const real *x, const real *u, real dt, const real *p, real *F, real *Q, int with_F)
{
    const long count = periods(dt, p);
    real at[N];
    (void)with_F;
    if (count < 0)
        return NO_PERIODS;
    memcpy(at, x, sizeof at);
    for (int i = 0; i < N * N; i++)
        F[i] = i % (N + 1) == 0, Q[i] = 0;
    for (long k = 0; k < count; k++) {
        real f[F_COUNT + 1], w[W_COUNT + 1], F_1[N * N] = {0}, half[N * N], turned[N * N];
        real total[N * N];
        slope(at, u, p, f);
        density(at, p, w);
        for (int l = 0; l < F_COUNT; l++)
            F_1[F_ROW[l] * N + F_COLUMN[l]] = f[l];
        dense_product(F_1, F, half);
        memcpy(F, half, sizeof half);
        dense_product(F_1, Q, half);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                turned[i * N + j] = half[j * N + i];
        dense_product(F_1, turned, total);
        for (int l = 0; l < W_COUNT; l++)
            total[W_ROW[l] * N + W_COLUMN[l]] += w[l];
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                Q[i * N + j] = (total[i * N + j] + total[j * N + i]) / 2;
        advance_once(at, u, p, at);
    }
    return all_finite(Q) && all_finite(F) ? DONE : OVERFLOW_WITHIN;
}

static int linearize(const real *x, const real *u, real dt, real max_step,
                     const real *p, real *moved, real *F, real *Q)
{
    const int outcome = flow(x, u, dt, p, F, Q, 1);
    advance(x, u, dt, max_step, p, moved, 0);
    return outcome;
}
