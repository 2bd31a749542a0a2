/* SPDX-License-Identifier: Apache-2.0
 *
 * The series of the matrices of a short step: F = exp(A), and Q, what noise of density W adds, with
 * the operations of `linear.discretize.flow` in the same order.
 *
 * What stands before this text is generated: ORDER, the number of rows; A_ROW, A_COLUMN of the
 * A_COUNT numbers of A that are not zero, and W_ROW, W_COLUMN, W_COUNT of W. Matrices are row by
 * row. A number is one, or several with the same operations: then NAMED tells their functions apart.
 */

#ifndef NAMED
#define NAMED(function) function
#define NUMBER real
#define TRUTH int
#define ANY(known) (known)
#define TERMS 18
#if ORDER > 6 /* where it takes the compiler long, and is no faster */
#undef UNROLLED
#define UNROLLED
#endif
#endif

/* C = factor A B, with A given by its count numbers a that are not zero, row by row */
INLINE void NAMED(product)(int count, const int *rows, const int *columns, const NUMBER *a,
                           real factor, const NUMBER *B, NUMBER *C)
{
    int k = 0;
    UNROLLED
    for (int i = 0; i < ORDER; i++) {
        NUMBER sum[ORDER];
        for (int j = 0; j < ORDER; j++)
            sum[j] = (NUMBER){0};
        UNROLLED
        for (; k < count && rows[k] == i; k++) {
            const NUMBER share = factor * a[k], *row = B + columns[k] * ORDER;
            for (int j = 0; j < ORDER; j++)
                sum[j] += share * row[j];
        }
        for (int j = 0; j < ORDER; j++)
            C[i * ORDER + j] = sum[j];
    }
}

/* a and w are the numbers of A and W; without with_F, F may remain unknown */
INLINE void NAMED(series)(const NUMBER *a, const NUMBER *w, int with_F, NUMBER *F, NUMBER *Q)
{
    NUMBER F_term[ORDER * ORDER], term[ORDER * ORDER], half[ORDER * ORDER];
    memset(F_term, 0, sizeof F_term);
    memset(term, 0, sizeof term);
    for (int k = 0; k < A_COUNT; k++)
        F_term[A_ROW[k] * ORDER + A_COLUMN[k]] = a[k];
    for (int k = 0; k < W_COUNT; k++)
        term[W_ROW[k] * ORDER + W_COLUMN[k]] = w[k];
    memcpy(F, F_term, sizeof F_term);
    memcpy(Q, term, sizeof term);
    for (int i = 0; i < ORDER; i++)
        F[i * ORDER + i] += (real)1;
    /* a series ends where its term changes no number of the sum */
    int grows = 1;
    for (int k = 2; k <= TERMS && grows; k++) {
        NAMED(product)(A_COUNT, A_ROW, A_COLUMN, a, 1 / (real)k, term, half);
        TRUTH changed = (TRUTH){0};
        for (int i = 0; i < ORDER; i++)
            for (int j = 0; j <= i; j++) {
                const NUMBER more = half[i * ORDER + j] + half[j * ORDER + i];
                const NUMBER sum = Q[i * ORDER + j] + more;
                term[i * ORDER + j] = more;
                term[j * ORDER + i] = more;
                changed |= sum != Q[i * ORDER + j];
                Q[i * ORDER + j] = sum;
            }
        grows = ANY(changed);
    }
    grows = with_F;
    for (int k = 2; k <= TERMS && grows; k++) {
        NAMED(product)(A_COUNT, A_ROW, A_COLUMN, a, 1 / (real)k, F_term, half);
        TRUTH changed = (TRUTH){0};
        for (int i = 0; i < ORDER * ORDER; i++) {
            const NUMBER sum = F[i] + half[i];
            F_term[i] = half[i];
            changed |= sum != F[i];
            F[i] = sum;
        }
        grows = ANY(changed);
    }
    for (int i = 0; i < ORDER; i++)
        for (int j = 0; j < i; j++)
            Q[j * ORDER + i] = Q[i * ORDER + j];
}
