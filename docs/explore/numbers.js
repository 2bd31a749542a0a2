// SPDX-License-Identifier: Apache-2.0
// Linear systems of up to four states. A matrix is an array of rows, a vector an array, a complex
// number a pair [re, im]. Each function has its counterpart in kalman_ros, against which it is tested.

export const zeros = (n, m) => Array.from({ length: n }, () => Array(m).fill(0));
export const diagonal = (...entries) => entries.map((entry, i) => entries.map((_, j) => (i === j ? entry : 0)));
export const identity = (n) => diagonal(...Array(n).fill(1));
export const transpose = (A) => A[0].map((_, j) => A.map((row) => row[j]));
export const column = (x) => x.map((entry) => [entry]);
export const scale = (A, factor) => A.map((row) => row.map((entry) => factor * entry));
export const add = (A, B, factor = 1) => A.map((row, i) => row.map((entry, j) => entry + factor * B[i][j]));
export const trace = (A) => A.reduce((sum, row, i) => sum + row[i], 0);
export const dot = (x, y) => x.reduce((sum, entry, i) => sum + entry * y[i], 0);
export const apply = (A, x) => A.map((row) => dot(row, x));
export const block = (A, i, j, n, m) => A.slice(i, i + n).map((row) => row.slice(j, j + m));
export const blocks = (rows) => rows.flatMap((parts) => parts[0].map((_, i) => parts.flatMap((part) => part[i])));

export function multiply(...factors) {
  return factors.reduce((A, B) => A.map((row) => B[0].map((_, j) => row.reduce((sum, entry, k) => sum + entry * B[k][j], 0))));
}

// X of A X = B, by elimination with row pivots; null if A is singular
export function solve(A, B) {
  const n = A.length, rows = A.map((row, i) => [...row, ...B[i]]);
  for (let k = 0; k < n; k++) {
    let pivot = k;
    for (let i = k + 1; i < n; i++) if (Math.abs(rows[i][k]) > Math.abs(rows[pivot][k])) pivot = i;
    if (!rows[pivot][k]) return null;
    [rows[k], rows[pivot]] = [rows[pivot], rows[k]];
    for (let i = 0; i < n; i++) {
      if (i === k) continue;
      const factor = rows[i][k] / rows[k][k];
      for (let j = k; j < rows[k].length; j++) rows[i][j] -= factor * rows[k][j];
    }
  }
  return rows.map((row, i) => row.slice(n).map((entry) => entry / row[i]));
}

export const inverse = (A) => solve(A, identity(A.length));

// exp(A), by a Pade approximant of degree 6, scaled and squared (Golub and Van Loan, 9.3.1)
export function expm(A) {
  const size = Math.max(...A.map((row) => row.reduce((sum, entry) => sum + Math.abs(entry), 0)));
  const halvings = Math.max(0, Math.ceil(Math.log2(size || 1)) + 1), X = scale(A, 2 ** -halvings);
  let power = identity(A.length), above = power, below = power;
  for (let k = 1, c = 1; k <= 6; k++) {
    c *= (7 - k) / (k * (13 - k));
    power = multiply(power, X);
    above = add(above, power, c);
    below = add(below, power, k % 2 ? -c : c);
  }
  let result = solve(below, above);
  for (let k = 0; k < halvings; k++) result = multiply(result, result);
  return result;
}

// F and G of x' = F x + G u, the input held for dt
export function sample(A, B, dt) {
  const n = A.length, m = B[0].length;
  const E = expm(scale(blocks([[A, B], [zeros(m, n), zeros(m, m)]]), dt));
  return [block(E, 0, 0, n, n), block(E, 0, n, n, m)];
}

// covariance of the noise that a spectral density W adds in dt (Van Loan, 1978)
export function sampledNoise(A, W, dt) {
  const n = A.length, E = expm(scale(blocks([[scale(A, -1), W], [zeros(n, n), transpose(A)]]), dt));
  return multiply(transpose(block(E, n, n, n, n)), block(E, 0, n, n, n));
}

// det(s I - A), highest power first, and the matrices of its adjugate (Faddeev and LeVerrier)
export function characteristic(A) {
  const n = A.length, coefficients = [1], adjugate = [];
  let M = identity(n);
  for (let k = 1; k <= n; k++) {
    adjugate.push(M);
    const product = multiply(A, M), c = -trace(product) / k;
    coefficients.push(c);
    M = add(product, identity(n), c);
  }
  return { coefficients, adjugate };
}

const times = ([a, b], [c, d]) => [a * c - b * d, a * d + b * c];
const over = ([a, b], [c, d]) => [(a * c + b * d) / (c * c + d * d), (b * c - a * d) / (c * c + d * d)];
const plus = ([a, b], [c, d]) => [a + c, b + d];

export const complex = { times, over, plus, size: ([a, b]) => Math.hypot(a, b), turn: (angle) => [Math.cos(angle), Math.sin(angle)] };

// the value of a polynomial, highest power first, at a complex number
export const polynomialAt = (coefficients, s) => coefficients.reduce((sum, c) => plus(times(sum, s), [c, 0]), [0, 0]);

// a b + c d without the rounding of the parts, each part being split in two (Dekker, 1971)
function discriminant(b, c) {
  const split = (x) => { const t = 134217729 * x, high = t - (t - x); return [high, x - high]; };
  const [h, l] = split(b / 2), square = (b / 2) ** 2, rest = ((h * h - square) + 2 * h * l) + l * l;
  return (square - c) + rest;
}

// the roots of a monic polynomial: of a square by its formula, of more by Aberth's iteration (1973)
export function roots(coefficients) {
  const n = coefficients.length - 1;
  if (n === 1) return [[-coefficients[1], 0]];
  if (n === 2) {
    const [, b, c] = coefficients, square = discriminant(b, c);
    if (square < 0) return [[-b / 2, Math.sqrt(-square)], [-b / 2, -Math.sqrt(-square)]];
    const far = -b / 2 - Math.sign(b || 1) * Math.sqrt(square);
    return [[far, 0], [far ? c / far : 0, 0]];
  }
  const slope = coefficients.slice(0, -1).map((c, k) => c * (n - k));
  const radius = Math.max(...coefficients.slice(1).map((c, k) => Math.abs(c) ** (1 / (k + 1)))) || 1;
  let found = coefficients.slice(1).map((_, k) => scale([complex.turn(2 * Math.PI * k / n + 0.4)], radius)[0]);
  for (let turn = 0; turn < 100; turn++) {
    let change = 0;
    found = found.map((z, i) => {
      const value = polynomialAt(coefficients, z);
      if (!complex.size(value)) return z;
      const newton = over(polynomialAt(slope, z), value);
      const others = found.reduce((sum, w, j) => (j === i ? sum : plus(sum, over([1, 0], [z[0] - w[0], z[1] - w[1]]))), [0, 0]);
      const step = over([1, 0], [newton[0] - others[0], newton[1] - others[1]]);
      if (!step.every(Number.isFinite)) return z;
      change = Math.max(change, complex.size(step));
      return [z[0] - step[0], z[1] - step[1]];
    });
    if (change < 1e-15 * radius) break;
  }
  return found.map(([a, b]) => [a, Math.abs(b) < 1e-12 * radius ? 0 : b]);
}

export const eigenvalues = (A) => roots(characteristic(A).coefficients);

// the polynomial with these roots, which come in conjugate pairs
export function polynomialOf(poles) {
  const product = poles.reduce((all, pole) => [...all, [0, 0]].map((c, k) => (k ? plus(c, times([-pole[0], -pole[1]], all[k - 1])) : c)), [[1, 0]]);
  return product.map(([re]) => re);
}

const powers = (A, b, n) => Array.from({ length: n }).reduce((all) => [...all, apply(A, all.at(-1))], [b]).slice(0, n);

// gain of u = -K x that places the poles of A - b K (Ackermann, 1972); null if b does not reach a mode
export function place(A, b, poles) {
  const n = A.length, reach = transpose(powers(A, b, n));
  const q = polynomialOf(poles).reduce((sum, c) => add(multiply(sum, A), identity(n), c), zeros(n, n));
  const last = solve(transpose(reach), column(identity(n)[n - 1]));
  return last && multiply(transpose(last), q)[0];
}

// P of A P + P A' + W = 0, for an A without a pair of eigenvalues whose sum is zero
export function lyapunov(A, W) {
  const n = A.length, big = zeros(n * n, n * n);
  for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) for (let k = 0; k < n; k++) {
    big[i * n + j][k * n + j] += A[i][k];
    big[i * n + j][i * n + k] += A[j][k];
  }
  const flat = solve(big, W.flat().map((entry) => [-entry]));
  return flat && W.map((row, i) => row.map((_, j) => (flat[i * n + j][0] + flat[j * n + i][0]) / 2));
}

// X of A' X + X A - X G X + Q = 0 that makes A - G X stable: by the sign of the Hamiltonian
// (Roberts, 1980), scaled by its determinant (Byers, 1987), and one step of Newton
export function riccati(A, G, Q) {
  const n = A.length;
  let Z = blocks([[A, scale(G, -1)], [scale(Q, -1), scale(transpose(A), -1)]]);
  for (let turn = 0; turn < 60; turn++) {
    const inverted = inverse(Z);
    if (!inverted) return null;
    const c = Math.sqrt(Math.hypot(...inverted.flat()) / Math.hypot(...Z.flat()));
    const next = scale(add(scale(Z, c), inverted, 1 / c), 0.5), change = Math.hypot(...add(next, Z, -1).flat());
    Z = next;
    if (change < 1e-14 * Math.hypot(...Z.flat())) break;
  }
  // (sign + I) [I; X] = 0
  const [W11, W12] = [block(Z, 0, 0, n, n), block(Z, 0, n, n, n)], [W21, W22] = [block(Z, n, 0, n, n), block(Z, n, n, n, n)];
  const left = blocks([[W12], [add(W22, identity(n))]]), right = blocks([[add(W11, identity(n))], [W21]]);
  let X = solve(multiply(transpose(left), left), scale(multiply(transpose(left), right), -1));
  for (let turn = 0; X && turn < 2; turn++) {
    const closed = add(A, multiply(G, X), -1);
    X = lyapunov(transpose(closed), add(Q, multiply(X, G, X)));
  }
  return X;
}

// gain K and cost X of the regulator u = -K x with the weights Qx and Qu
export function lqr(A, B, Qx, Qu) {
  const N = solve(Qu, transpose(B)), X = riccati(A, multiply(B, N), Qx);
  return X && { K: multiply(N, X), X };
}

// gain L and covariance P of the filter for noise of density W in the state and V in the readings
export function lqe(A, C, W, V) {
  const dual = lqr(transpose(A), transpose(C), W, V);
  return dual && { L: transpose(dual.K), P: dual.X };
}

// c (s I - A)^-1 b at a complex s
export function transfer(A, b, c, s) {
  const { coefficients, adjugate } = characteristic(A);
  return over(polynomialAt(adjugate.map((M) => dot(c, apply(M, b))), s), polynomialAt(coefficients, s));
}

// what a reading y of h x with noise of variance R makes of a belief: Joseph's form
export function update({ x, P }, h, y, R) {
  const Ph = apply(P, h), S = dot(h, Ph) + R, L = Ph.map((entry) => entry / S), innovation = y - dot(h, x);
  const I = add(identity(x.length), L.map((l) => h.map((entry) => l * entry)), -1);
  const noise = L.map((a) => L.map((b) => a * R * b));
  return { x: x.map((entry, i) => entry + L[i] * innovation), P: add(multiply(I, P, transpose(I)), noise), L, S, innovation };
}

export const predict = ({ x, P }, F, Q) => ({ x: apply(F, x), P: add(multiply(F, P, transpose(F)), Q) });

// L of L L' = P
export function cholesky(P) {
  const L = zeros(P.length, P.length);
  for (let i = 0; i < P.length; i++) for (let j = 0; j <= i; j++) {
    const rest = P[i][j] - dot(L[i].slice(0, j), L[j].slice(0, j));
    L[i][j] = i === j ? Math.sqrt(Math.max(0, rest)) : rest / L[j][j];
  }
  return L;
}

// sigma points and weights of the unscented transform (Julier and Uhlmann, 1997)
export function sigmaPoints({ x, P }, kappa) {
  const n = x.length, L = transpose(cholesky(scale(P, n + kappa)));
  const points = [x, ...L.map((l) => x.map((entry, i) => entry + l[i])), ...L.map((l) => x.map((entry, i) => entry - l[i]))];
  return { points, weights: points.map((_, k) => (k ? 0.5 : kappa) / (n + kappa)) };
}

// mean and covariance of weighted points
export function moments(points, weights) {
  const x = points[0].map((_, i) => points.reduce((sum, point, k) => sum + weights[k] * point[i], 0));
  const P = x.map((_, i) => x.map((__, j) => points.reduce((sum, point, k) => sum + weights[k] * (point[i] - x[i]) * (point[j] - x[j]), 0)));
  return { x, P };
}

// states of x' = F x, from x on, `count` steps
export function path(F, x, count) {
  const states = [x];
  for (let k = 0; k < count; k++) states.push(apply(F, states.at(-1)));
  return states;
}

// normal random numbers that are the same for one seed
export function normals(seed) {
  let state = seed >>> 0;
  const uniform = () => {
    state = (state + 0x6d2b79f5) >>> 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return (((t ^ (t >>> 14)) >>> 0) + 0.5) / 4294967296;
  };
  return () => Math.sqrt(-2 * Math.log(uniform())) * Math.cos(2 * Math.PI * uniform());
}
