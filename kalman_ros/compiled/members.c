/* SPDX-License-Identifier: Apache-2.0
 *
 * Steps as numpy calls them: with arguments and results behind each other in one array. COUNT is the
 * number of numbers of a model.
 */

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

/* here v holds a covariance of each member, too, and receives x' and F P F' + Q after a number of
 * steps of length dt */
FAST void predictions(double *v, long count, double dt, double max_step, long number,
                      const double *first, long sets)
{
    const double *x = v, *u = x + count * N, *p = first, *P = u + count * M;
    double *moved = v + count * (N + M + N * N), *out = moved + count * N;
    double F[N * N], Q[N * N], FP[N * N];
    EACH(k, count) {
        const double *from = x, *before = P;
        int failed = 0;
        for (long step = 0; step < number; step++, from = moved, before = out) {
            failed |= linearize(from, u, dt, max_step, p, moved, F, Q);
            dense_product(F, before, FP);
            for (int i = 0; i < N; i++)
                for (int j = 0; j <= i; j++) {
                    double sum = 0.5 * (Q[i * N + j] + Q[j * N + i]);
                    for (int l = 0; l < N; l++)
                        sum += FP[i * N + l] * F[j * N + l];
                    out[i * N + j] = out[j * N + i] = failed ? NAN : sum;
                }
        }
        moved += N, P += N * N, out += N * N;
    }
}

/* here v receives the Q of a step alone */
void noises(double *v, long count, double dt, const double *first, long sets)
{
    const double *x = v, *u = x + count * N, *p = first;
    double *Q = v + count * (N + M), F[N * N];
    EACH(k, count) {
        if (flow(x, u, dt, p, F, Q, 0))
            for (int i = 0; i < N * N; i++)
                Q[i] = NAN;
        Q += N * N;
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
