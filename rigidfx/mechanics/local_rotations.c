/* Rotations of nodes by the cells around them: see local_rotations.py, which has the equations.

   Matrices are stored row by row. */

/* Adds Σ (x - x̄)(X - X̄)ᵀ of each cell to the matrices of its nodes, with x = X + u. */
void spread(int cells, int per, const int *nodes, const double *X, const double *u, double *M)
{
  for (int c = 0; c < cells; ++c, nodes += per) {
    double A[9] = {0}, middle[3] = {0}, now[3] = {0};
    for (int j = 0; j < per; ++j)
      for (int i = 0; i < 3; ++i) {
        middle[i] += X[3 * nodes[j] + i] / per;
        now[i] += (X[3 * nodes[j] + i] + u[3 * nodes[j] + i]) / per;
      }
    for (int j = 0; j < per; ++j) {
      const double *at = X + 3 * nodes[j], *by = u + 3 * nodes[j];
      for (int i = 0; i < 3; ++i) {
        const double x = at[i] + by[i] - now[i];
        for (int k = 0; k < 3; ++k)
          A[3 * i + k] += x * (at[k] - middle[k]);
      }
    }
    for (int j = 0; j < per; ++j)
      for (int i = 0; i < 9; ++i)
        M[9 * nodes[j] + i] += A[i];
  }
}

/* R ← R cay(δ) */
static void turn_by(const double *d, double *R)
{
  const double less = 1 + 0.25 * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
  for (int i = 0; i < 3; ++i) {
    double *r = R + 3 * i;
    const double a = r[1] * d[2] - r[2] * d[1], b = r[2] * d[0] - r[0] * d[2],
                 c = r[0] * d[1] - r[1] * d[0];
    r[0] += (a + 0.5 * (b * d[2] - c * d[1])) / less;
    r[1] += (b + 0.5 * (c * d[0] - a * d[2])) / less;
    r[2] += (c + 0.5 * (a * d[1] - b * d[0])) / less;
  }
}

/* One step of Newton's method for the rotation R of M; -1 where M has none near R. */
static double corrected(const double *M, double *R)
{
  double B[9], H[9], C[9], d[3];
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      B[3 * i + j] = R[i] * M[j] + R[3 + i] * M[3 + j] + R[6 + i] * M[6 + j];
  const double trace = B[0] + B[4] + B[8];
  const double a[3] = {B[7] - B[5], B[2] - B[6], B[3] - B[1]};
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      H[3 * i + j] = (i == j) * trace - 0.5 * (B[3 * i + j] + B[3 * j + i]);
  for (int i = 0; i < 3; ++i) /* cofactors */
    for (int j = 0; j < 3; ++j) {
      const int p = (i + 1) % 3, q = (i + 2) % 3, r = (j + 1) % 3, s = (j + 2) % 3;
      C[3 * i + j] = H[3 * p + r] * H[3 * q + s] - H[3 * p + s] * H[3 * q + r];
    }
  const double det = H[0] * C[0] + H[1] * C[1] + H[2] * C[2];
  /* Definite, and by far no line of nodes, which has no direction across. */
  if (!(trace > 0 && C[8] > 0 && H[0] > 0 && det > 1e-6 * trace * trace * trace))
    return -1;
  for (int i = 0; i < 3; ++i)
    d[i] = (C[3 * i] * a[0] + C[3 * i + 1] * a[1] + C[3 * i + 2] * a[2]) / det;
  turn_by(d, R);
  return d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
}

/* Improves the rotations of some matrices; tells of each whether it has been found. */
void fit(int count, int most, double enough, const double *M, double *R, char *found)
{
  for (int k = 0; k < count; ++k) {
    double left = enough + 1;
    for (int n = 0; n < most && left > enough; ++n) {
      left = corrected(M + 9 * k, R + 9 * k);
      if (left < 0)
        break;
    }
    found[k] = left >= 0 && left <= enough;
  }
}

/* y ← Q y, or Qᵀ y, of vectors that begin at some places. */
void turn(int count, const int *starts, int transposed, const double *Q, double *y)
{
  const int row = transposed ? 1 : 3, column = transposed ? 3 : 1;
  for (int k = 0; k < count; ++k, Q += 9) {
    double *v = y + starts[k];
    const double a = v[0], b = v[1], c = v[2];
    for (int i = 0; i < 3; ++i)
      v[i] = Q[row * i] * a + Q[row * i + column] * b + Q[row * i + 2 * column] * c;
  }
}
