/* SPDX-License-Identifier: Apache-2.0
 *
 * One step of a model, and its linearisation: `core.Model.step` and `linear.discretize.flow` for
 * one state, with the same operations in the same order.
 *
 * What comes before this text is generated from the model: N states, M inputs, COUNT numbers and
 * MOST_SUBSTEPS; the functions derivative, substep, wrap, jacobian and density; the places A_ROW, A_COLUMN of the A_COUNT
 * numbers of the Jacobian that are not zero, and W_ROW, W_COLUMN, W_COUNT of the density; with
 * SLOPE also the function slope and F_ROW, F_COLUMN, F_COUNT of the F of a substep, whose product
 * is that of the step. p are the numbers of the model. Matrices are row by row.
 */

#define TERMS 18
#define NEGLIGIBLE 1e-16

enum { DONE = 0, INFINITE_JACOBIAN = 1, OVERFLOW_WITHIN = 2 };

/* C = factor A B, with A given by its count numbers a that are not zero, row by row */
INLINE void product(int count, const int *rows, const int *columns, const double *a,
                    double factor, const double *B, double *C)
{
    int k = 0;
    for (int i = 0; i < N; i++) {
        double sum[N] = {0.0};
        for (; k < count && rows[k] == i; k++) {
            const double share = factor * a[k], *row = B + columns[k] * N;
            for (int j = 0; j < N; j++)
                sum[j] += share * row[j];
        }
        memcpy(C + i * N, sum, sizeof sum);
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
INLINE void dense_product(const double *A, const double *B, double *C)
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

FAST static int flow(const double *x, const double *u, double dt, const double *p, double *F,
                double *Q)
{
    double a[A_COUNT + 1], w[W_COUNT + 1], sums[N] = {0.0}, norm = 0.0;
    double F_term[N * N] = {0.0}, term[N * N] = {0.0}, half[N * N];
    jacobian(x, u, p, a);
    density(x, p, w);
    for (int k = 0; k < A_COUNT; k++)
        sums[A_COLUMN[k]] += fabs(a[k]);
    for (int j = 0; j < N; j++)
        norm = sums[j] > norm || isnan(sums[j]) ? sums[j] : norm;
    double reach = 2.0 * fabs(dt) * norm;
    if (!(reach < INFINITY))
        return INFINITE_JACOBIAN;
    int halvings = reach > 1.0 ? (int)ceil(log2(reach)) : 0;
    double h = ldexp(dt, -halvings);

    for (int k = 0; k < A_COUNT; k++)
        F_term[A_ROW[k] * N + A_COLUMN[k]] = a[k] *= h;
    for (int k = 0; k < W_COUNT; k++)
        term[W_ROW[k] * N + W_COLUMN[k]] = w[k] * h;
    memcpy(F, F_term, sizeof F_term);
    memcpy(Q, term, sizeof term);
    for (int i = 0; i < N; i++)
        F[i * N + i] += 1.0;
    /* a series ends where its term is negligible in every entry: those that are zero stay so */
    int F_grows = 1, Q_grows = 1;
    for (int k = 2; k <= TERMS && Q_grows; k++) {
        product(A_COUNT, A_ROW, A_COLUMN, a, 1.0 / k, term, half);
        Q_grows = 0;
        for (int i = 0; i < N; i++)
            for (int j = 0; j <= i; j++) {
                double sum = Q[i * N + j];
                term[i * N + j] = term[j * N + i] = half[i * N + j] + half[j * N + i];
                Q[i * N + j] += term[i * N + j];
                Q_grows |= !(fabs(term[i * N + j]) <= NEGLIGIBLE * fabs(sum));
            }
    }
    for (int k = 2; k <= TERMS && F_grows; k++) {
        product(A_COUNT, A_ROW, A_COLUMN, a, 1.0 / k, F_term, half);
        F_grows = 0;
        for (int i = 0; i < N * N; i++) {
            double sum = F[i];
            F[i] += F_term[i] = half[i];
            F_grows |= !(fabs(half[i]) <= NEGLIGIBLE * fabs(sum));
        }
    }
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i; j++)
            Q[j * N + i] = Q[i * N + j];
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
        memcpy(F, half, sizeof half);
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

/* The following do the same of count members, each with the next of sets of numbers, COUNT in each:
 * v holds an x and a u of each member, first all x, and receives the results in the same way.
 */
#define EACH(k, count) \
    for (long k = 0; k < count; k++, x += N, u += M, p = k % sets ? p + COUNT : first)

void linearized_steps(double *v, long count, double dt, double max_step, const double *first,
                      long sets)
{
    const double *x = v, *u = x + count * N, *p = first;
    double *moved = v + count * (N + M), *F = moved + count * N, *Q = F + count * N * N;
    EACH(k, count) {
        if (linearize(x, u, dt, max_step, p, moved, F, Q))
            for (int i = 0; i < N * N; i++)
                F[i] = Q[i] = NAN;
        moved += N, F += N * N, Q += N * N;
    }
}

/* here v holds a covariance of each member, too, and receives x' and F P F' + Q */
FAST void predictions(double *v, long count, double dt, double max_step, const double *first, long sets)
{
    const double *x = v, *u = x + count * N, *p = first, *P = u + count * M;
    double *moved = v + count * (N + M + N * N), *out = moved + count * N;
    double F[N * N], Q[N * N], FP[N * N];
    EACH(k, count) {
        int failed = linearize(x, u, dt, max_step, p, moved, F, Q);
        dense_product(F, P, FP);
        for (int i = 0; i < N; i++)
            for (int j = 0; j <= i; j++) {
                double sum = 0.5 * (Q[i * N + j] + Q[j * N + i]);
                for (int l = 0; l < N; l++)
                    sum += FP[i * N + l] * F[j * N + l];
                out[i * N + j] = out[j * N + i] = failed ? NAN : sum;
            }
        moved += N, P += N * N, out += N * N;
    }
}

void steps(double *v, long count, double dt, double max_step, const double *first, long sets)
{
    const double *x = v, *u = x + count * N, *p = first;
    double *moved = v + count * (N + M);
    EACH(k, count) {
        advance(x, u, dt, max_step, p, moved, 0);
        moved += N;
    }
}

void rates(double *v, long count, const double *first, long sets)
{
    const double *x = v, *u = x + count * N, *p = first;
    double *rate = v + count * (N + M);
    EACH(k, count) {
        derivative(x, u, p, rate);
        rate += N;
    }
}
