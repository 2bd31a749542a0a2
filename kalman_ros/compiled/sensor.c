/* SPDX-License-Identifier: Apache-2.0
 *
 * What a sensor reads, and how that changes with the state: N states, K numbers of a
 * reading; p are the numbers of the sensor.
 */

/* v holds count states, and receives their readings behind them */
void readings(double *v, long count, const double *p)
{
    for (long k = 0; k < count; k++)
        measure(v + k * N, p, v + count * N + k * K);
}

/* v holds x, and receives H behind it, column by column */
void slope(double *v, const double *p)
{
    double h[H_COUNT + 1], *H = v + N;
    jacobian(v, p, h);
    memset(H, 0, N * K * sizeof *H);
    for (int k = 0; k < H_COUNT; k++)
        H[H_COLUMN[k] * K + H_ROW[k]] = h[k];
}
