/* SPDX-License-Identifier: Apache-2.0
 *
 * One step of a model, and its linearisation: `core.Model.step` and `linear.discretize.flow` for
 * one state, with the same operations in the same order.
 *
 * What comes before this text is generated from the model: N states, M inputs and MOST_SUBSTEPS;
 * the functions substep, wrap, jacobian and density; the places A_ROW, A_COLUMN of the A_COUNT
 * numbers of the Jacobian that are not zero, and W_ROW, W_COLUMN, W_COUNT of the density; with
 * SLOPE also the function slope and F_ROW, F_COLUMN, F_COUNT of the F of a substep, whose product
 * is that of the step. p are the numbers of the model. Matrices are row by row.
 */

#define TERMS 18
#define NEGLIGIBLE 1e-15

enum { DONE = 0, INFINITE_JACOBIAN = 1, OVERFLOW_WITHIN = 2 };

/* C = factor A B, with A given by its count numbers a that are not zero */
static void product(int count, const int *rows, const int *columns, const double *a,
                    double factor, const double *B, double *C)
{
    memset(C, 0, N * N * sizeof *C);
    for (int k = 0; k < count; k++) {
        const double share = factor * a[k], *row = B + columns[k] * N;
        double *sum = C + rows[k] * N;
        for (int j = 0; j < N; j++)
            sum[j] += share * row[j];
    }
}

/* F, where it is wanted, receives the derivative of the step */
static void advance(const double *x, const double *u, double dt, double max_step,
                    const double *p, double *moved, double *F)
{
    double last[N], next[N];
    double count = fmax(1.0, ceil(fmin(fabs(dt) / max_step, MOST_SUBSTEPS)));
    double h = dt / count;
    memcpy(last, x, sizeof last);
    for (double k = 0.0; k < count; k += 1.0) {
#ifdef SLOPE
        if (F) {
            double f[F_COUNT + 1], before[N * N];
            slope(last, u, &h, p, f);
            memcpy(before, F, sizeof before);
            product(F_COUNT, F_ROW, F_COLUMN, f, 1.0, before, F);
        }
#endif
        substep(last, u, &h, p, next);
        memcpy(last, next, sizeof last);
    }
    wrap(last, moved);
}

/* C = A B */
static void dense_product(const double *A, const double *B, double *C)
{
    memset(C, 0, N * N * sizeof *C);
    for (int i = 0; i < N; i++)
        for (int k = 0; k < N; k++)
            for (int j = 0; j < N; j++)
                C[i * N + j] += A[i * N + k] * B[k * N + j];
}

static int all_finite(const double *A)
{
    for (int i = 0; i < N * N; i++)
        if (!isfinite(A[i]))
            return 0;
    return 1;
}

static int flow(const double *x, const double *u, double dt, const double *p, double *F,
                double *Q)
{
    static const double zero[N * N];
    double a[A_COUNT + 1], w[W_COUNT + 1], sums[N] = {0.0};
    double F_term[N * N], term[N * N], half[N * N];
    jacobian(x, u, p, a);
    density(x, p, w);
    double norm = 0.0;
    for (int k = 0; k < A_COUNT; k++)
        sums[A_COLUMN[k]] += fabs(a[k]);
    for (int j = 0; j < N; j++)
        norm = sums[j] > norm || isnan(sums[j]) ? sums[j] : norm;
    double reach = 2.0 * fabs(dt) * norm;
    if (!(reach < INFINITY))
        return INFINITE_JACOBIAN;
    int halvings = reach > 1.0 ? (int)ceil(log2(reach)) : 0;
    double h = ldexp(dt, -halvings);
    double bound = reach = ldexp(reach, -halvings);

    memcpy(F_term, zero, sizeof zero);
    memcpy(term, zero, sizeof zero);
    for (int k = 0; k < A_COUNT; k++)
        F_term[A_ROW[k] * N + A_COLUMN[k]] = a[k] *= h;
    for (int k = 0; k < W_COUNT; k++)
        term[W_ROW[k] * N + W_COLUMN[k]] = w[k] * h;
    memcpy(F, F_term, sizeof zero);
    memcpy(Q, term, sizeof zero);
    for (int i = 0; i < N; i++)
        F[i * N + i] += 1.0;
    for (int k = 2; k <= TERMS && bound >= NEGLIGIBLE; k++) {
        product(A_COUNT, A_ROW, A_COLUMN, a, 1.0 / k, term, half);
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                term[i * N + j] = half[i * N + j] + half[j * N + i];
        for (int i = 0; i < N * N; i++)
            Q[i] += term[i];
        product(A_COUNT, A_ROW, A_COLUMN, a, 1.0 / k, F_term, half);
        memcpy(F_term, half, sizeof zero);
        for (int i = 0; i < N * N; i++)
            F[i] += F_term[i];
        bound *= reach / k;
    }
    for (int k = 0; k < halvings; k++) {
        for (int i = 0; i < N; i++)
            for (int j = 0; j < N; j++)
                F_term[i * N + j] = F[j * N + i];
        dense_product(F, Q, half);
        dense_product(half, F_term, term);
        for (int i = 0; i < N; i++)
            for (int j = 0; j <= i; j++)
                Q[i * N + j] = Q[j * N + i] += 0.5 * (term[i * N + j] + term[j * N + i]);
        dense_product(F, F, half);
        memcpy(F, half, sizeof zero);
    }
    return all_finite(Q) && (!halvings || all_finite(F)) ? DONE : OVERFLOW_WITHIN;
}

static int linearize(const double *x, const double *u, double dt, double max_step,
                     const double *p, double *moved, double *F, double *Q)
{
    int outcome = flow(x, u, dt, p, F, Q);
#ifdef SLOPE
    memset(F, 0, N * N * sizeof *F);
    for (int i = 0; i < N; i++)
        F[i * N + i] = 1.0;
    advance(x, u, dt, max_step, p, moved, F);
#else
    advance(x, u, dt, max_step, p, moved, 0);
#endif
    return outcome;
}

/* v holds x and u, and receives x', F and Q behind them */
int linearized_step(double *v, double dt, double max_step, const double *p)
{
    double *u = v + N, *moved = u + M;
    return linearize(v, u, dt, max_step, p, moved, moved + N, moved + N + N * N);
}

/* v holds an x and a u for each of count members, and receives their x' behind them */
void steps(double *v, long count, double dt, double max_step, const double *p)
{
    double *u = v + count * N, *moved = u + count * M;
    for (long k = 0; k < count; k++)
        advance(v + k * N, u + k * M, dt, max_step, p, moved + k * N, 0);
}
