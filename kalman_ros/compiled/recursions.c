/* SPDX-License-Identifier: Apache-2.0
 *
 * Recursions over the readings of a pass, for models of any size. Readings have one row of H, of the
 * transpose of K and of a matrix that whitens for each of their numbers.
 */

/* C += A B for A of rows times n numbers, many of which are zero, and B of n times columns */
INLINE void add_product(long rows, long n, long columns, const double *A, const double *B, double *C)
{
    for (long i = 0; i < rows; i++)
        for (long l = 0; l < n; l++) {
            const double a = A[i * n + l], *from = B + l * columns;
            double *to = C + i * columns;
            if (a != 0)
                for (long j = 0; j < columns; j++)
                    to[j] += a * from[j];
        }
}

/* The mean errors of n states by p faults, and what they change in count readings of k numbers each:
 * an error becomes F times itself, and what a step adds to q of the faults from the first one on; a
 * reading is changed by H times it, and by what Z has, and corrects it by K. Z receives the changes,
 * whitened by rows of m numbers. room is of n p numbers. */
FAST void respond(long count, long n, long p, const double *F, const long *k, const double *H,
                  const double *K, const double *white, long m, long first, long q,
                  const double *added, double *error, double *room, double *Z)
{
    for (long at = 0; at < count; at++, F += n * n, added += n * q) {
        memcpy(room, error, n * p * sizeof *error);
        memset(error, 0, n * p * sizeof *error);
        add_product(n, n, p, F, room, error);
        for (long i = 0; i < n; i++)
            for (long j = 0; j < q; j++)
                error[i * p + first + j] += added[i * q + j];
        add_product(k[at], n, p, H, error, Z);
        for (long r = 0; r < k[at]; r++)
            for (long i = 0; i < n; i++)
                for (long j = 0; j < p; j++)
                    error[i * p + j] -= K[r * n + i] * Z[r * p + j];
        for (long r = k[at] - 1; r >= 0; r--) { /* from below, since a row takes those above it */
            for (long j = 0; j < p; j++)
                Z[r * p + j] *= white[r * m + r];
            add_product(1, r, p, white + r * m, Z, Z + r * p);
        }
        H += k[at] * n, K += k[at] * n, white += k[at] * m, Z += k[at] * p;
    }
}

/* P of n states becomes F P F' + Q, symmetric; room is of 2 n n numbers. */
INLINE void stepped(long n, const double *F, const double *Q, double *P, double *room)
{
    double *FP = room, *turned = room + n * n;
    memset(FP, 0, n * n * sizeof *FP);
    add_product(n, n, n, F, P, FP);
    for (long i = 0; i < n; i++)
        for (long j = 0; j < n; j++)
            turned[j * n + i] = FP[i * n + j];
    memcpy(P, Q, n * n * sizeof *P);
    add_product(n, n, n, F, turned, P);
    for (long i = 0; i < n; i++)
        for (long j = 0; j < i; j++)
            P[i * n + j] = P[j * n + i] = 0.5 * (P[i * n + j] + P[j * n + i]);
}

/* -2 log likelihood of count innovations of k numbers each, which read H times n numbers with noise
 * of covariance R (rows of m numbers). These have a mean x and covariance P before the first one,
 * from which what moved at each is taken, and F and Q in the step to each. means and covariances, if
 * they are wanted, receive these after each one. Not a number where no covariance is definite. */
FAST double follow(long count, long n, const double *F, const double *Q, const long *k,
                   const double *H, const double *R, long m, const double *innovation,
                   const double *moved, double *x, double *P, double *means, double *covariances,
                   double *room)
{
    double misfit = 0, *L = room, *e = L + m * m, *W = e + m, *last = W + m * n, *rest = last + n;
    for (long at = 0; at < count; at++) {
        const long size = k[at];
        if (at) {
            F += n * n, Q += n * n;
            for (long i = 0; i < n; i++)
                last[i] = x[i] - moved[i];
            memset(x, 0, n * sizeof *x);
            add_product(n, n, 1, F, last, x);
            stepped(n, F, Q, P, rest);
            moved += n;
        }
        memset(W, 0, size * n * sizeof *W);
        add_product(size, n, n, H, P, W);
        for (long r = 0; r < size; r++) { /* e = L^-1 of what is left, and W = L^-1 H P */
            e[r] = innovation[r];
            for (long l = 0; l < n; l++)
                e[r] -= H[r * n + l] * x[l];
            for (long c = 0; c <= r; c++) {
                double sum = R[r * m + c];
                for (long l = 0; l < n; l++)
                    sum += W[r * n + l] * H[c * n + l];
                L[r * m + c] = sum;
            }
        }
        for (long r = 0; r < size; r++) {
            for (long c = 0; c <= r; c++) {
                double sum = L[r * m + c];
                for (long l = 0; l < c; l++)
                    sum -= L[r * m + l] * L[c * m + l];
                if (c == r && !(sum > 0))
                    return NAN;
                L[r * m + c] = c == r ? sqrt(sum) : sum / L[c * m + c];
            }
            for (long l = 0; l < r; l++) {
                e[r] -= L[r * m + l] * e[l];
                for (long j = 0; j < n; j++)
                    W[r * n + j] -= L[r * m + l] * W[l * n + j];
            }
            e[r] /= L[r * m + r];
            for (long j = 0; j < n; j++)
                W[r * n + j] /= L[r * m + r];
            misfit += e[r] * e[r] + 2 * log(L[r * m + r]) + log(2 * acos(-1.0));
        }
        for (long r = 0; r < size; r++)
            for (long i = 0; i < n; i++) {
                x[i] += W[r * n + i] * e[r];
                for (long j = 0; j < n; j++)
                    P[i * n + j] -= W[r * n + i] * W[r * n + j];
            }
        if (means) {
            memcpy(means + at * n, x, n * sizeof *x);
            memcpy(covariances + at * n * n, P, n * n * sizeof *P);
        }
        H += size * n, R += size * m, innovation += size;
    }
    return misfit;
}
