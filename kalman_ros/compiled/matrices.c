/* SPDX-License-Identifier: Apache-2.0
 *
 * Square matrices of ORDER rows.
 */

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
