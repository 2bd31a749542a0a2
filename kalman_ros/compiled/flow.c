/* SPDX-License-Identifier: Apache-2.0
 *
 * The matrices of a step about a point, `linear.discretize.flow` with the same operations in the
 * same order: F = exp(A dt), and Q, what noise of density W adds.
 *
 * What stands before this text is generated: ORDER, the number of rows; the functions jacobian and
 * density, of x, u and p and of x and p; A_ROW, A_COLUMN of the A_COUNT numbers of the Jacobian that
 * are not zero, and W_ROW, W_COLUMN, W_COUNT of the density. Matrices are row by row.
 */

#define TERMS 18

enum { DONE = 0, INFINITE_JACOBIAN = 1, OVERFLOW_WITHIN = 2 };

/* C = factor A B, with A given by its count numbers a that are not zero, row by row */
INLINE void product(int count, const int *rows, const int *columns, const real *a,
                    real factor, const real *B, real *C)
{
    int k = 0;
    for (int i = 0; i < ORDER; i++) {
        real sum[ORDER] = {0};
        for (; k < count && rows[k] == i; k++) {
            const real share = factor * a[k], *row = B + columns[k] * ORDER;
            for (int j = 0; j < ORDER; j++)
                sum[j] += share * row[j];
        }
        for (int j = 0; j < ORDER; j++)
            C[i * ORDER + j] = sum[j];
    }
}

/* C = A B */
INLINE void dense_product(const real *A, const real *B, real *C)
{
    memset(C, 0, ORDER * ORDER * sizeof *C);
    for (int i = 0; i < ORDER; i++)
        for (int k = 0; k < ORDER; k++)
            for (int j = 0; j < ORDER; j++)
                C[i * ORDER + j] += A[i * ORDER + k] * B[k * ORDER + j];
}

static int all_finite(const real *A)
{
    for (int i = 0; i < ORDER * ORDER; i++)
        if (!isfinite(A[i]))
            return 0;
    return 1;
}

/* without with_F, F may remain unknown */
FAST static int flow(const real *x, const real *u, real dt, const real *p, real *F, real *Q,
                     int with_F)
{
    real a[A_COUNT + 1], w[W_COUNT + 1], sums[ORDER] = {0}, norm = 0;
    real F_term[ORDER * ORDER] = {0}, term[ORDER * ORDER] = {0}, half[ORDER * ORDER];
    jacobian(x, u, p, a);
    density(x, p, w);
    for (int k = 0; k < A_COUNT; k++)
        sums[A_COLUMN[k]] += fabs(a[k]);
    for (int j = 0; j < ORDER; j++)
        norm = sums[j] > norm || isnan(sums[j]) ? sums[j] : norm;
    real reach = 2 * fabs(dt) * norm;
    if (!(reach < INFINITY))
        return INFINITE_JACOBIAN;
    int halvings = reach > 1 ? (int)ceil(log2(reach)) : 0;
    real h = ldexp(dt, -halvings);

    for (int k = 0; k < A_COUNT; k++)
        F_term[A_ROW[k] * ORDER + A_COLUMN[k]] = a[k] *= h;
    for (int k = 0; k < W_COUNT; k++)
        term[W_ROW[k] * ORDER + W_COLUMN[k]] = w[k] * h;
    memcpy(F, F_term, sizeof F_term);
    memcpy(Q, term, sizeof term);
    for (int i = 0; i < ORDER; i++)
        F[i * ORDER + i] += 1;
    /* a series ends where its term changes no number of the sum */
    int F_grows = with_F || halvings, Q_grows = 1;
    for (int k = 2; k <= TERMS && Q_grows; k++) {
        product(A_COUNT, A_ROW, A_COLUMN, a, 1 / (real)k, term, half);
        Q_grows = 0;
        for (int i = 0; i < ORDER; i++)
            for (int j = 0; j <= i; j++) {
                const real more = half[i * ORDER + j] + half[j * ORDER + i];
                const real sum = Q[i * ORDER + j] + more;
                term[i * ORDER + j] = more;
                term[j * ORDER + i] = more;
                Q_grows |= sum != Q[i * ORDER + j];
                Q[i * ORDER + j] = sum;
            }
    }
    for (int k = 2; k <= TERMS && F_grows; k++) {
        product(A_COUNT, A_ROW, A_COLUMN, a, 1 / (real)k, F_term, half);
        F_grows = 0;
        for (int i = 0; i < ORDER * ORDER; i++) {
            const real sum = F[i] + half[i];
            F_term[i] = half[i];
            F_grows |= sum != F[i];
            F[i] = sum;
        }
    }
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < i; j++)
            Q[j * ORDER + i] = Q[i * ORDER + j];
    for (int k = 0; k < halvings; k++) {
        for (int i = 0; i < ORDER; i++)
            for (int j = 0; j < ORDER; j++)
                F_term[i * ORDER + j] = F[j * ORDER + i];
        dense_product(F, Q, half);
        dense_product(half, F_term, term);
        for (int i = 0; i < ORDER; i++)
            for (int j = 0; j <= i; j++) {
                Q[j * ORDER + i] += (term[i * ORDER + j] + term[j * ORDER + i]) / 2;
                Q[i * ORDER + j] = Q[j * ORDER + i];
            }
        dense_product(F, F, half);
        memcpy(F, half, sizeof half);
    }
    return all_finite(Q) && (!halvings || all_finite(F)) ? DONE : OVERFLOW_WITHIN;
}

