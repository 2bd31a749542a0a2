/* SPDX-License-Identifier: Apache-2.0
 *
 * Exact steps of a linear system, x' = F x + G u + w: `linear.discretize.Discretization` with the
 * same operations, and `core.LinearSystem` for one state.
 *
 * What stands before this text is matrices.c, N states, M inputs, and the function wrap. The numbers
 * p are twice the norm of A, and TERMS terms of the series, each of F', G' and Q' row by row.
 */

enum { DONE = 0, LONG_STEP = 1, OVERFLOW_WITHIN = 2 };
#define F_BY_FLOW 1
/* as `flow` of several members at once: they follow one after the other */
#define flows(x, u, dt, p, F, Q, with_F) 0
#define step_once advance
/* with more halvings, too many digits of F - I are lost beside the diagonal of F */
#define MANY_HALVINGS 8
#define TERM ((2 * N + M) * N)

/* F, G and Q of a step */
FAST static int sample(real dt, const real *p, real *F, real *G, real *Q)
{
    const real reach = p[0] * fabs(dt), *term = p + 1;
    if (!(reach <= 1 << MANY_HALVINGS))
        return LONG_STEP;
    const int halvings = reach > 1 ? (int)ceil(log2(reach)) : 0;
    const real h = ldexp(dt, -halvings);
    real sum[TERM], power = h;
    memcpy(sum, term, sizeof sum);
    /* the series ends where its term changes no number of the sum */
    for (int k = 1, grows = 1; k < TERMS && grows; k++, power *= h) {
        grows = 0;
        term += TERM;
        for (int i = 0; i < TERM; i++) {
            const real more = sum[i] + power * term[i];
            grows |= more != sum[i];
            sum[i] = more;
        }
    }
    for (int i = 0; i < N; i++) {
        for (int j = 0; j < N; j++) {
            F[i * N + j] = sum[j * N + i];
            Q[i * N + j] = (sum[(N + M + j) * N + i] + sum[(N + M + i) * N + j]) / 2;
        }
        for (int j = 0; j < M; j++)
            G[i * M + j] = sum[(N + j) * N + i];
    }
    for (int k = 0; k < halvings; k++) {
        real before[N * N], input[N * M + 1], half[N * N], turned[N * N];
        memcpy(before, F, sizeof before);
        memcpy(input, G, N * M * sizeof *G);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                turned[i * N + j] = before[j * N + i];
        for (int i = 0; i < N; i++)
            for (int l = 0; l < N; l++)
                for (int j = 0; j < M; j++)
                    G[i * M + j] += before[i * N + l] * input[l * M + j];
        dense_product(before, Q, half);
        dense_product(half, turned, F);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                half[i * N + j] = Q[i * N + j] + (F[i * N + j] + F[j * N + i]) / 2;
        memcpy(Q, half, sizeof half);
        dense_product(before, before, F);
    }
    int finite = !halvings || (all_finite(F) && all_finite(Q));
    for (int i = 0; halvings && i < N * M; i++)
        finite &= isfinite(G[i]) != 0;
    return finite ? DONE : OVERFLOW_WITHIN;
}

/* matrices receives F, G and Q of a step, one behind the other; nonzero where there are none */
int sampled(double *matrices, double dt, const double *p)
{
    return sample(dt, p, matrices, matrices + N * N, matrices + N * N + N * M);
}

static int linearize(const real *x, const real *u, real dt, real max_step, const real *p,
                     real *moved, real *F, real *Q)
{
    real G[N * M + 1], total[N];
    const int outcome = sample(dt, p, F, G, Q);
    (void)max_step;
    if (outcome)
        return outcome;
    for (int i = 0; i < N; i++) {
        total[i] = 0;
        for (int j = 0; j < N; j++)
            total[i] += F[i * N + j] * x[j];
        for (int j = 0; j < M; j++)
            total[i] += G[i * M + j] * u[j];
    }
    wrap(total, moved);
    return DONE;
}

/* a step without its matrices, NaN where it has none */
static void advance(const real *x, const real *u, real dt, real max_step,
                    const real *p, real *moved, real *F)
{
    real slope[N * N], Q[N * N];
    (void)F;
    if (linearize(x, u, dt, max_step, p, moved, slope, Q))
        for (int i = 0; i < N; i++)
            moved[i] = NAN;
}
