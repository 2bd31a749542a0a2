/* SPDX-License-Identifier: Apache-2.0
 *
 * Predictions and corrections of beliefs as numpy calls them: with arguments and results behind each
 * other in one array. COUNT is the number of numbers of a model.
 */

/* `linearize` of some members, at most LANES; what fails is NaN. */
INLINE void linearize_some(int some, const double *x, const double *u, double dt, double max_step,
                           const double **p, double *moved, double *F, double *Q)
{
    const int known = some == LANES && flows(x, u, dt, p, F, Q, F_BY_FLOW);
    for (int l = 0; l < some; l++, x += N, u += M, moved += N, F += N * N, Q += N * N) {
        if (known)
            step_once(x, u, dt, max_step, p[l], moved, F);
        else if (linearize(x, u, dt, max_step, p[l], moved, F, Q))
            for (int i = 0; i < N * N; i++)
                F[i] = Q[i] = NAN;
    }
}

/* The following do the same of count members, each with the next of sets of numbers, COUNT in each:
 * v holds an x and a u of each member, first all x, and receives the results in the same way.
 */
#define SOME(k, count) \
    for (long k = 0, some; some = count - k < LANES ? count - k : LANES, k < count; \
         k += some, x += some * N, u += some * M)
#define NUMBERS(k) \
    const double *p[LANES]; \
    for (long l = 0; l < some; l++) \
        p[l] = first + (k + l) % sets * COUNT

/* A matrix of a large model has many zeros, which add nothing. */
#define ADDS(number) (N < 8 || (number) != 0)

INLINE void add_row(double *to, double factor, const double *row)
{
    for (int j = 0; j < N; j++)
        to[j] += factor * row[j];
}

/* out += A P A' for a symmetric P, right above the diagonal; a sum over columns after the other,
 * whole rows at a time */
INLINE void add_congruent(const double *A, const double *P, double *out)
{
    double AP[N * N] = {0}, turned[N * N];
    for (int i = 0; i < N; i++)
        for (int l = 0; l < N; l++)
            if (ADDS(A[i * N + l]))
                add_row(AP + i * N, A[i * N + l], P + l * N);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            turned[i * N + j] = AP[j * N + i];
    for (int i = 0; i < N; i++)
        for (int l = 0; l < N; l++)
            if (ADDS(A[i * N + l]))
                add_row(out + i * N, A[i * N + l], turned + l * N);
}

/* out = F P F' + Q, symmetric */
INLINE void sandwiched(const double *F, const double *P, const double *Q, double *out)
{
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            out[i * N + j] = 0.5 * (Q[i * N + j] + Q[j * N + i]);
    add_congruent(F, P, out);
    for (int i = 0; i < N; i++)
        for (int j = 0; j < i; j++)
            out[i * N + j] = out[j * N + i];
}

/* S of k rows becomes its factor L; 0 where it is not positive definite */
INLINE int factored(double *S, long k)
{
    for (long j = 0; j < k; j++) {
        double pivot = S[j * k + j];
        for (long l = 0; l < j; l++)
            pivot -= S[j * k + l] * S[j * k + l];
        if (!(pivot > 0))
            return 0;
        S[j * k + j] = sqrt(pivot);
        for (long i = j + 1; i < k; i++) {
            double sum = S[i * k + j];
            for (long l = 0; l < j; l++)
                sum -= S[i * k + l] * S[j * k + l];
            S[i * k + j] = sum / S[j * k + j];
        }
    }
    return 1;
}

/* 0 for a belief that is hardly positive definite, or so large that its square is not finite, which
 * is to be looked at more closely */
INLINE int definite(const double *x, const double *P)
{
    double L[N * N];
    for (int i = 0; i < N; i++)
        if (!(fabs(x[i]) < 1e150 && P[i * N + i] < 1e150))
            return 0;
    memcpy(L, P, sizeof L);
    if (!factored(L, N))
        return 0;
    for (int i = 0; i < N; i++)
        if (!(L[i * N + i] * L[i * N + i] > 1e-10 * P[i * N + i]))
            return 0;
    return 1;
}

/* here v holds a covariance of each member, too, and receives x' and F P F' + Q after a number of
 * steps of length dt; of one member, whether the result is definite stands behind it */
FAST void predictions(double *v, long count, double dt, double max_step, long number,
                      const double *first, long sets)
{
    const double *x = v, *u = x + count * N, *P = u + count * M;
    double *moved = v + count * (N + M + N * N), *out = moved + count * N;
    double F[LANES * N * N], Q[LANES * N * N], after[N * N], next[LANES * N];
    SOME(k, count) {
        const double *from = x, *before = P;
        NUMBERS(k);
        for (long step = 0; step < number; step++, from = moved, before = out) {
            linearize_some(some, from, u, dt, max_step, p, next, F, Q);
            memcpy(moved, next, some * N * sizeof *next);
            for (long l = 0; l < some; l++) {
                sandwiched(F + l * N * N, before + l * N * N, Q + l * N * N, after);
                memcpy(out + l * N * N, after, sizeof after);
            }
        }
        moved += some * N, P += some * N * N, out += some * N * N;
    }
    *out = count == 1 && definite(moved - N, out - N * N);
}

INLINE void corrected(double *v, long count, long k)
{
    const double *x = v, *P = x + count * N, *H = P + count * N * N, *R = H + count * k * N,
                 *e = R + count * k * k;
    double *mean = v + count * (N + N * N + k * N + k * k + k), *out = mean + count * N,
           *K = out + count * N * N, *S = K + count * N * k, *square = S + count * k * k;
    for (long member = 0; member < count; member++) {
        double whitened[MOST_READ], L[MOST_READ * MOST_READ], left[N * N], after[N * N] = {0};
        /* k rows: H P, and of the columns of the gain and of that times R */
        double HP[MOST_READ * N] = {0}, gain[MOST_READ * N], noisy[MOST_READ * N] = {0};
        for (long r = 0; r < k; r++)
            for (int l = 0; l < N; l++)
                if (ADDS(H[r * N + l]))
                    add_row(HP + r * N, H[r * N + l], P + l * N);
        memcpy(S, R, k * k * sizeof *S);
        for (int l = 0; l < N; l++)
            for (long r = 0; r < k; r++)
                for (long c = 0; c < k; c++)
                    S[r * k + c] += HP[r * N + l] * H[c * N + l];
        for (long r = 0; r < k; r++)
            for (long c = 0; c <= r; c++)
                L[r * k + c] = S[r * k + c] = S[c * k + r] = 0.5 * (S[r * k + c] + S[c * k + r]);
        const int good = factored(L, k);
        *square = good ? 0 : INFINITY;
        for (long r = 0; good && r < k; r++) {
            whitened[r] = e[r];
            for (long l = 0; l < r; l++)
                whitened[r] -= L[r * k + l] * whitened[l];
            whitened[r] /= L[r * k + r];
            *square += whitened[r] * whitened[r];
        }
        memcpy(gain, HP, k * N * sizeof *HP);
        for (long r = 0; r < k; r++) {
            for (long l = 0; l < r; l++)
                add_row(gain + r * N, -L[r * k + l], gain + l * N);
            for (int j = 0; j < N; j++)
                gain[r * N + j] /= L[r * k + r];
        }
        for (long r = k - 1; r >= 0; r--) {
            for (long l = r + 1; l < k; l++)
                add_row(gain + r * N, -L[l * k + r], gain + l * N);
            for (int j = 0; j < N; j++)
                gain[r * N + j] = good ? gain[r * N + j] / L[r * k + r] : NAN;
        }
        memcpy(mean, x, N * sizeof *x);
        for (long r = 0; r < k; r++) {
            add_row(mean, e[r], gain + r * N);
            for (int j = 0; j < N; j++)
                K[j * k + r] = gain[r * N + j];
            for (long c = 0; c < k; c++)
                add_row(noisy + c * N, R[r * k + c], gain + r * N);
        }
        for (int j = 0; j < N; j++)
            for (int l = 0; l < N; l++)
                left[j * N + l] = j == l;
        for (int j = 0; j < N; j++)
            for (long r = 0; r < k; r++)
                add_row(left + j * N, -gain[r * N + j], H + r * N);
        add_congruent(left, P, after);
        for (int i = 0; i < N; i++) {
            for (long c = 0; c < k; c++)
                add_row(after + i * N, gain[c * N + i], noisy + c * N);
            for (int j = i; j < N; j++)
                out[i * N + j] = out[j * N + i] = after[i * N + j];
        }
        x += N, P += N * N, H += k * N, R += k * k, e += k;
        mean += N, out += N * N, K += N * k, S += k * k, square++;
    }
}

/* Readings of k numbers: v holds x, P, H, R and the innovation of each member, first all x, and
 * receives the mean, the covariance in Joseph's form, the gain K, S and the square of the whitened
 * innovation behind them. Where k is known to the compiler, loops become sums.
 */
FAST void corrections(double *v, long count, long k)
{
    if (k == 1)
        corrected(v, count, 1);
    else if (k == 2)
        corrected(v, count, 2);
    else if (k == 3)
        corrected(v, count, 3);
    else
        corrected(v, count, k);
}
