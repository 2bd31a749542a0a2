/* SPDX-License-Identifier: Apache-2.0
 *
 * How errors of a space with rotations move its points: N coordinates.
 */

/* v holds total, origin and P, and receives the mean and its covariance behind them */
void arrive(double *v)
{
    arrived(v, v + N, v + 2 * N, v + 2 * N + N * N);
}

/* v holds a and b, and receives a - b behind them */
void subtract(double *v)
{
    difference(v, v + N, v + 2 * N);
}
