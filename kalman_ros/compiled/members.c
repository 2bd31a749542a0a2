/* SPDX-License-Identifier: Apache-2.0
 *
 * Steps of members as numpy calls them. What stands before this text is beliefs.c.
 */

/* v holds x and u, and receives x', F and Q behind them */
int linearized_step(double *v, double dt, double max_step, const double *p)
{
    double *u = v + N, *moved = u + M;
    return linearize(v, u, dt, max_step, p, moved, moved + N, moved + N + N * N);
}

void linearized_steps(double *v, long count, double dt, double max_step, const double *first,
                      long sets)
{
    const double *x = v, *u = x + count * N;
    double *moved = v + count * (N + M), *F = moved + count * N, *Q = F + count * N * N;
    SOME(k, count) {
        NUMBERS(k);
        linearize_some(some, x, u, dt, max_step, p, moved, F, Q);
        moved += some * N, F += some * N * N, Q += some * N * N;
    }
}

/* P becomes its factor, lower triangular, with zeros for columns whose pivot is at most a tolerance
 * of its variance; where that is NaN, with NaN for those without a positive pivot */
INLINE void factorise(double *P, double tolerance)
{
    for (int j = 0; j < N; j++) {
        double pivot = P[j * N + j];
        const double least = isnan(tolerance) ? 0 : tolerance * pivot;
        for (int l = 0; l < j; l++)
            pivot -= P[j * N + l] * P[j * N + l];
        const int good = pivot > least;
        const double scale = good ? 1 / sqrt(pivot) : isnan(tolerance) ? NAN : 0;
        P[j * N + j] = pivot * scale;
        for (int i = j + 1; i < N; i++) {
            double sum = P[i * N + j];
            for (int l = 0; l < j; l++)
                sum -= P[i * N + l] * P[j * N + l];
            P[i * N + j] = sum * scale;
            P[j * N + i] = 0;
        }
    }
}

/* v holds a covariance of each of count members, and receives their factors */
void factors(double *v, long count)
{
    double *L = v + count * N * N;
    memcpy(L, v, count * N * N * sizeof *v);
    for (long k = 0; k < count; k++)
        factorise(L + k * N * N, NAN);
}

/* here v receives the Q of a step alone */
void noises(double *v, long count, double dt, const double *first, long sets)
{
    const double *x = v, *u = x + count * N;
    double *Q = v + count * (N + M), F[LANES * N * N];
    SOME(k, count) {
        NUMBERS(k);
        const int known = some == LANES && flows(x, u, dt, p, F, Q, 0);
        for (long l = 0; l < some; l++, Q += N * N)
            if (!known && flow(x + l * N, u + l * M, dt, p[l], F, Q, 0))
                for (int i = 0; i < N * N; i++)
                    Q[i] = NAN;
    }
}

#define EACH(k, count) \
    for (long k = 0; k < count; k++, x += N, u += M, p = k % sets ? p + COUNT : first)

/* here v holds standard normal numbers of each member, too, and receives x' with the noise of these */
void noisy_steps(double *v, long count, double dt, double max_step, const double *first, long sets)
{
    const double *x = v, *u = x + count * N, *normal = u + count * M;
    double *moved = v + count * (N + M + N);
    double F[LANES * N * N], Q[LANES * N * N], total[N];
    SOME(k, count) {
        NUMBERS(k);
        const int known = some == LANES && flows(x, u, dt, p, F, Q, 0);
        for (long l = 0; l < some; l++, normal += N, moved += N) {
            double *L = Q + l * N * N;
            if (!known && flow(x + l * N, u + l * M, dt, p[l], F, L, 0))
                L[0] = NAN;
            factorise(L, 1e-12);
            advance(x + l * N, u + l * M, dt, max_step, p[l], total, 0);
            for (int i = 0; i < N; i++)
                for (int j = 0; j <= i; j++)
                    total[i] += L[i * N + j] * normal[j];
            wrap(total, moved);
        }
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
