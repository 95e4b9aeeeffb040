/* Assumed natural strains of 8-node hexahedra that are thin in a known direction: see
   mechanics/enhanced.py. It stands behind enhanced.c and needs what that declares.

   Components are natural ones, E_ij = ½ (g_i·g_j - G_i·G_j) by coordinates from 0 to 1, the third
   across the thickness, shears twice. Those in the surface are of the integration points; E13 comes
   from the middles of two edges, E23 from those of the others, E33 from those at the four corners,
   and all is interpolated. Each is quadratic in the displacement. */

enum { ASSUMED = 7, FRONT = 0, SIDE = 2, CORNER = 4, SAMPLES = 8 };

/* Of E23, E13 (from two places each) and E33 (from four): places where they are taken, and by what
   a point has of each, for each direction of the thickness. */
static double sampled[3][SAMPLES][3][NODES], share[3][SAMPLES][POINTS];
static double own[3][POINTS][3][NODES];  /* derivatives of shape functions at the points */

/* Component of each sample, and the directions of its two vectors. */
static const int SAMPLE[SAMPLES] = {4, 4, 5, 5, 2, 2, 2, 2};

/* A cell's natural frame at its points. */
typedef struct {
  int axis;
  double x[DOFS];                      /* corners, by direction, then by node */
  double weight[POINTS];
  double K[POINTS][3][3];              /* inverse of J, the thickness's row last */
  double M[POINTS][PAIRS][ASSUMED];    /* modes */
} thin_t;

/* Of λ and μ: the modes' stresses with their weights, and the factor of D, 1/L on its diagonal. */
typedef struct {
  double C[POINTS][PAIRS][PAIRS];              /* with their weights */
  double CM[POINTS][PAIRS][ASSUMED];
  double L[ASSUMED][ASSUMED];
} resist_t;

static void direction(int axis, int i, int *original)
{
  *original = (axis + 1 + i) % 3;
}

void prepare_assumed(void)
{
  const double a = 0.5 - 0.5 / sqrt(3.0);
  for (int axis = 0; axis < 3; axis++) {
    int to[3];
    for (int i = 0; i < 3; i++)
      direction(axis, i, &to[i]);
    for (int s = 0; s < SAMPLES; s++) {
      double xi[3] = {0.5, 0.5, 0.5};
      if (s < SIDE)
        xi[to[0]] = s - FRONT;
      else if (s < CORNER)
        xi[to[1]] = s - SIDE;
      else {
        xi[to[0]] = (s - CORNER) & 1;
        xi[to[1]] = (s - CORNER) >> 1;
      }
      for (int i = 0; i < 3; i++)
        for (int n = 0; n < NODES; n++)
          sampled[axis][s][i][n] = slope(n, to[i], xi);
      for (int p = 0; p < POINTS; p++) {
        double at[2];
        for (int i = 0; i < 2; i++)
          at[i] = p >> (2 - to[i]) & 1 ? 1.0 - a : a;
        double f = 1.0;
        if (s < SIDE || s >= CORNER)
          f *= xi[to[0]] > 0.5 ? at[0] : 1.0 - at[0];
        if (s >= SIDE)
          f *= xi[to[1]] > 0.5 ? at[1] : 1.0 - at[1];
        share[axis][s][p] = f;
      }
    }
    for (int p = 0; p < POINTS; p++)
      for (int i = 0; i < 3; i++)
        memcpy(own[axis][p][i], slopes[p][to[i]].at, sizeof own[axis][p][i]);
  }
}

static void look_at_thin(const double *x, int axis, thin_t *t)
{
  /* The modes: 11: ξ, 22: η, 12: ξ, η, 33: ζ, ξζ, ηζ. */
  static const int of[ASSUMED] = {0, 1, 3, 3, 2, 2, 2};
  static const int by[ASSUMED][3] = {{1, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 1, 0},
                                     {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
  double middle[3][NODES], K0[3][3] = {{0}}, j0 = 0.0, j;
  t->axis = axis;
  for (int n = 0; n < NODES; n++)
    for (int k = 0; k < 3; k++)
      t->x[NODES * k + n] = x[3 * n + k];
  for (int i = 0; i < 3; i++) {
    int to;
    direction(axis, i, &to);
    memcpy(middle[i], slopes[POINTS][to].at, sizeof middle[i]);
  }
  for (int p = -1; p < POINTS; p++) {
    const double(*d)[NODES] = p < 0 ? middle : own[axis][p];
    double J[3][3] = {{0}}, H[3][3] = {{0}};
    for (int k = 0; k < 3; k++)
      for (int i = 0; i < 3; i++)
        for (int n = 0; n < NODES; n++)
          J[k][i] += t->x[NODES * k + n] * d[i][n];
    if (p < 0) {
      inverse(J, K0, &j0);
      continue;
    }
    inverse(J, t->K[p], &j);
    t->weight[p] = fabs(j) / POINTS;
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        for (int l = 0; l < 3; l++)
          H[i][k] += K0[i][l] * J[l][k];
    for (int m = 0; m < ASSUMED; m++) {
      double f = j0 / j;
      for (int i = 0; i < 3; i++) {
        int to;
        direction(axis, i, &to);
        if (by[m][i] && !(p >> (2 - to) & 1))
          f = -f;
      }
      const int a = PAIR[of[m]][0], b = PAIR[of[m]][1];
      for (int q = 0; q < PAIRS; q++) {
        const int i = PAIR[q][0], k = PAIR[q][1];
        const double e = 0.5 * f * (H[a][i] * H[b][k] + H[b][i] * H[a][k]);
        t->M[p][q][m] = q < 3 ? e : 2.0 * e;
      }
    }
  }
}

static void resist(const thin_t *t, double lambda, double mu, resist_t *r)
{
  double D[ASSUMED][ASSUMED] = {{0}};
  for (int p = 0; p < POINTS; p++) {
    double g[3][3] = {{0}};
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++)
          g[i][j] += t->K[p][i][k] * t->K[p][j][k];
    for (int a = 0; a < PAIRS; a++) {
      for (int b = 0; b < PAIRS; b++) {
        const int i = PAIR[a][0], j = PAIR[a][1], k = PAIR[b][0], l = PAIR[b][1];
        r->C[p][a][b] = t->weight[p] * (lambda * g[i][j] * g[k][l]
                                        + mu * (g[i][k] * g[j][l] + g[i][l] * g[j][k]));
      }
      for (int m = 0; m < ASSUMED; m++) {
        double s = 0.0;
        for (int b = 0; b < PAIRS; b++)
          s += r->C[p][a][b] * t->M[p][b][m];
        r->CM[p][a][m] = s;
      }
    }
    for (int m = 0; m < ASSUMED; m++)
      for (int n = 0; n <= m; n++)
        for (int a = 0; a < PAIRS; a++)
          D[m][n] += t->M[p][a][m] * r->CM[p][a][n];
  }
  for (int n = 0; n < ASSUMED; n++)
    for (int m = n; m < ASSUMED; m++) {
      double s = D[m][n];
      for (int k = 0; k < n; k++)
        s -= r->L[m][k] * r->L[n][k];
      r->L[m][n] = m == n ? 1.0 / sqrt(s) : s * r->L[n][n];
    }
}

/* g_i = Σ x ∂N/∂ξ_i, x by direction. */
static void vectors(const double d[3][NODES], const double *x, double g[3][3])
{
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) {
      double s = 0.0;
      for (int n = 0; n < NODES; n++)
        s += x[NODES * k + n] * d[i][n];
      g[i][k] = s;
    }
}

static double component(int q, const double g[3][3], const double h[3][3])
{
  const int i = PAIR[q][0], j = PAIR[q][1];
  double s = 0.0;
  for (int k = 0; k < 3; k++)
    s += g[i][k] * h[j][k] + g[j][k] * h[i][k];
  return q < 3 ? 0.5 * s : s;
}

/* Assumed strains at u1 less those at u0, if there is one; and the displacement's own. */
static void thin_strains(const thin_t *t, const double *u0, const double *u1,
                         double E[POINTS][PAIRS], double compatible[POINTS][PAIRS])
{
  double x[DOFS], step[DOFS], taken[SAMPLES], g[3][3], h[3][3];
  for (int k = 0; k < 3; k++)
    for (int n = 0; n < NODES; n++) {
      const int to = NODES * k + n, at = 3 * n + k;
      x[to] = t->x[to] + 0.5 * (u0 ? u0[at] + u1[at] : u1[at]);
      step[to] = u0 ? u1[at] - u0[at] : u1[at];
    }
  for (int s = 0; s < SAMPLES; s++) {
    vectors(sampled[t->axis][s], x, g);
    vectors(sampled[t->axis][s], step, h);
    taken[s] = component(SAMPLE[s], g, h);
  }
  for (int p = 0; p < POINTS; p++) {
    vectors(own[t->axis][p], x, g);
    vectors(own[t->axis][p], step, h);
    for (int q = 0; q < PAIRS; q++) {
      compatible[p][q] = component(q, g, h);
      E[p][q] = q < 2 || q == 3 ? compatible[p][q] : 0.0;
    }
    for (int s = 0; s < SAMPLES; s++)
      E[p][SAMPLE[s]] += share[t->axis][s][p] * taken[s];
  }
}

/* Adds what makes strains orthogonal to the modes. */
static void add_modes(const thin_t *t, const resist_t *r, double E[POINTS][PAIRS])
{
  double a[ASSUMED];
  for (int m = 0; m < ASSUMED; m++) {
    a[m] = 0.0;
    for (int p = 0; p < POINTS; p++)
      for (int q = 0; q < PAIRS; q++)
        a[m] -= r->CM[p][q][m] * E[p][q];
    for (int k = 0; k < m; k++)
      a[m] -= r->L[m][k] * a[k];
    a[m] *= r->L[m][m];
  }
  for (int m = ASSUMED - 1; m >= 0; m--) {
    a[m] *= r->L[m][m];
    for (int k = 0; k < m; k++)
      a[k] -= r->L[m][k] * a[m];
  }
  for (int p = 0; p < POINTS; p++)
    for (int q = 0; q < PAIRS; q++)
      for (int m = 0; m < ASSUMED; m++)
        E[p][q] += t->M[p][q][m] * a[m];
}

/* What is to be added to the displacement's own strain: Cartesian components, in order of pairs. */
static void enhance_thin(const thin_t *t, const resist_t *r, const double *u0, const double *u1,
                         double *eta)
{
  double E[POINTS][PAIRS], compatible[POINTS][PAIRS];
  thin_strains(t, u0, u1, E, compatible);
  add_modes(t, r, E);
  for (int p = 0; p < POINTS; p++)
    for (int b = 0; b < PAIRS; b++) {
      const int i = PAIR[b][0], j = PAIR[b][1];
      double s = 0.0;
      for (int q = 0; q < PAIRS; q++) {
        const int k = PAIR[q][0], l = PAIR[q][1];
        double f = t->K[p][k][i] * t->K[p][l][j];
        if (k != l)
          f = 0.5 * (f + t->K[p][l][i] * t->K[p][k][j]);
        s += f * (E[p][q] - compatible[p][q]);
      }
      eta[p * PAIRS + b] = s;
    }
}

/* Derivatives of assumed strains by the displacement; columns by direction, then by node. */
static void thin_rows(const thin_t *t, const double *u, double B[POINTS][PAIRS][DOFS])
{
  double x[DOFS], rows[SAMPLES][DOFS], g[3][3];
  for (int d = 0; d < DOFS; d++)
    x[d] = t->x[d] + u[3 * (d % NODES) + d / NODES];
  for (int s = 0; s < SAMPLES; s++) {
    const double(*d)[NODES] = sampled[t->axis][s];
    const int i = PAIR[SAMPLE[s]][0], j = PAIR[SAMPLE[s]][1];
    const double f = i == j ? 0.5 : 1.0;
    vectors(d, x, g);
    for (int k = 0; k < 3; k++)
      for (int n = 0; n < NODES; n++)
        rows[s][NODES * k + n] = f * (g[i][k] * d[j][n] + g[j][k] * d[i][n]);
  }
  memset(B, 0, POINTS * sizeof *B);
  for (int p = 0; p < POINTS; p++) {
    const double(*d)[NODES] = own[t->axis][p];
    vectors(d, x, g);
    for (int q = 0; q < 4; q++) {
      if (q == 2)
        continue;
      const int i = PAIR[q][0], j = PAIR[q][1];
      const double f = i == j ? 0.5 : 1.0;
      for (int k = 0; k < 3; k++)
        for (int n = 0; n < NODES; n++)
          B[p][q][NODES * k + n] = f * (g[i][k] * d[j][n] + g[j][k] * d[i][n]);
    }
    for (int s = 0; s < SAMPLES; s++)
      for (int c = 0; c < DOFS; c++)
        B[p][SAMPLE[s]][c] += share[t->axis][s][p] * rows[s][c];
  }
}

/* Adds what stresses S, with weights, do as the rows turn: to the blocks of equal directions. */
static void add_turning(const thin_t *t, double S[POINTS][PAIRS], double factor, double *A)
{
  double K[NODES][NODES] = {{0}};
  for (int s = 0; s < SAMPLES + POINTS; s++) {
    const int point = s - SAMPLES;
    const double(*d)[NODES] = point < 0 ? sampled[t->axis][s] : own[t->axis][point];
    for (int q = 0; q < PAIRS; q++) {
      double f = 0.0;
      if (point >= 0 && (q < 2 || q == 3))
        f = S[point][q];
      for (int p = 0; point < 0 && q == SAMPLE[s] && p < POINTS; p++)
        f += share[t->axis][s][p] * S[p][q];
      if (f == 0.0)
        continue;
      const int i = PAIR[q][0], j = PAIR[q][1];
      f *= i == j ? 0.5 : 1.0;
      for (int m = 0; m < NODES; m++)
        for (int n = 0; n < NODES; n++)
          K[m][n] += f * (d[i][m] * d[j][n] + d[j][m] * d[i][n]);
    }
  }
  for (int m = 0; m < NODES; m++)
    for (int n = 0; n < NODES; n++)
      for (int k = 0; k < 3; k++)
        A[(3 * m + k) * DOFS + 3 * n + k] += factor * K[m][n];
}

/* Adds factor leftᵀ ∂S̃/∂Ẽ right. */
static void add_stiffness(const resist_t *r, double left[POINTS][PAIRS][DOFS],
                          double right[POINTS][PAIRS][DOFS], double factor, double *A)
{
  double K[DOFS][DOFS] = {{0}}, l[ASSUMED][DOFS] = {{0}}, e[ASSUMED][DOFS] = {{0}};
  for (int p = 0; p < POINTS; p++)
    for (int a = 0; a < PAIRS; a++) {
      double row[DOFS] = {0};
      for (int b = 0; b < PAIRS; b++)
        for (int d = 0; d < DOFS; d++)
          row[d] += r->C[p][a][b] * right[p][b][d];
      for (int c = 0; c < DOFS; c++)
        for (int d = 0; d < DOFS; d++)
          K[c][d] += left[p][a][c] * row[d];
      for (int m = 0; m < ASSUMED; m++)
        for (int d = 0; d < DOFS; d++) {
          l[m][d] += r->CM[p][a][m] * left[p][a][d];
          e[m][d] += r->CM[p][a][m] * right[p][a][d];
        }
    }
  for (int m = 0; m < ASSUMED; m++) {
    for (int k = 0; k < m; k++)
      for (int d = 0; d < DOFS; d++) {
        l[m][d] -= r->L[m][k] * l[k][d];
        e[m][d] -= r->L[m][k] * e[k][d];
      }
    for (int d = 0; d < DOFS; d++) {
      l[m][d] *= r->L[m][m];
      e[m][d] *= r->L[m][m];
    }
    for (int c = 0; c < DOFS; c++)
      for (int d = 0; d < DOFS; d++)
        K[c][d] -= l[m][c] * e[m][d];
  }
  for (int c = 0; c < DOFS; c++)
    for (int d = 0; d < DOFS; d++)
      A[(3 * (c % NODES) + c / NODES) * DOFS + 3 * (d % NODES) + d / NODES] += factor * K[c][d];
}
