/* Forces of stresses that are no linear function of strains: see mechanics/projected.py. It stands
   behind enhanced.c and assumed.c and needs what they declare.

   Enhanced and assumed strains are Ẽ = P E, P linear and fixed for a cell. A stress S at the points
   does the work ∫ S : P δE = ∫ Pᵀ S : δE, and its tangent is

       (P B½)ᵀ ∂S/∂Ẽ (P B₁) + (Pᵀ S) : ∂B½/∂u₁,    B = ∂E/∂u.

   S and ∂S/∂Ẽ at the points come from a kernel of FFCx. Strains here are those of the cell's frame,
   shears twice; stresses have their weights. */

/* S, and ∂S/∂Ẽ by strains whose shears count twice. */
typedef struct {
  double S[POINTS][PAIRS], C[POINTS][PAIRS][PAIRS];
} response_t;

typedef double at_points_t[POINTS][PAIRS][DOFS];

/* How Cartesian stresses become those of a frame, K being the inverse of its J. */
static void turn_stress(const double K[3][3], double Q[PAIRS][PAIRS])
{
  for (int a = 0; a < PAIRS; a++)
    for (int b = 0; b < PAIRS; b++) {
      const int i = PAIR[a][0], j = PAIR[a][1], k = PAIR[b][0], l = PAIR[b][1];
      Q[a][b] = K[i][k] * K[j][l] + (k != l ? K[i][l] * K[j][k] : 0.0);
    }
}

/* What FFCx's kernel has found at a point, in a frame and with the point's weight. */
static void take_response(const double *found, int tangent, const double K[3][3], double weight,
                          double *S, double C[PAIRS][PAIRS])
{
  double Q[PAIRS][PAIRS], half[PAIRS][PAIRS] = {{0}};
  turn_stress(K, Q);
  for (int a = 0; a < PAIRS; a++) {
    S[a] = 0.0;
    for (int b = 0; b < PAIRS; b++)
      S[a] += weight * Q[a][b] * found[b];
  }
  if (!tangent)
    return;
  for (int a = 0; a < PAIRS; a++)
    for (int c = 0; c < PAIRS; c++)
      for (int b = 0; b < PAIRS; b++)
        half[a][b] += weight * Q[a][c] * found[PAIRS + PAIRS * c + b];
  for (int a = 0; a < PAIRS; a++)
    for (int b = 0; b < PAIRS; b++) {
      double s = 0.0;
      for (int c = 0; c < PAIRS; c++)
        s += half[a][c] * Q[b][c];
      C[a][b] = s;
    }
}

/* Adds Σ rowsᵀ S. */
static void add_forces(double S[POINTS][PAIRS], at_points_t B, double *A)
{
  for (int p = 0; p < POINTS; p++)
    for (int a = 0; a < PAIRS; a++)
      for (int d = 0; d < DOFS; d++)
        A[3 * (d % NODES) + d / NODES] += S[p][a] * B[p][a][d];
}

/* Adds Σ leftᵀ C right. */
static void add_moduli(double C[POINTS][PAIRS][PAIRS], at_points_t left, at_points_t right,
                       double *A)
{
  double K[DOFS][DOFS] = {{0}};
  for (int p = 0; p < POINTS; p++)
    for (int a = 0; a < PAIRS; a++) {
      double row[DOFS] = {0};
      for (int b = 0; b < PAIRS; b++)
        for (int d = 0; d < DOFS; d++)
          row[d] += C[p][a][b] * right[p][b][d];
      for (int c = 0; c < DOFS; c++)
        for (int d = 0; d < DOFS; d++)
          K[c][d] += left[p][a][c] * row[d];
    }
  for (int c = 0; c < DOFS; c++)
    for (int d = 0; d < DOFS; d++)
      A[(3 * (c % NODES) + c / NODES) * DOFS + 3 * (d % NODES) + d / NODES] += K[c][d];
}

/* Enhanced strains ------------------------------------------------------------------------------ */

/* P B at a displacement, or B alone. */
static void enhanced_rows(const cell_t *c, const law_t *law, const double *u, int project,
                          at_points_t out)
{
  double b[PAIRS][POINTS][DOFS], t[PAIRS][POINTS][DOFS], a[MODES][DOFS];
  rows(c, u, b);
  if (project) {
    memcpy(t, b, sizeof t);
    modes_of_rows(c, law, t, &a[0][0]);
    memset(t, 0, sizeof t);
    for (int m = MODES - 1; m >= 0; m--) {
      for (int d = 0; d < DOFS; d++)
        a[m][d] *= law->L[m][m];
      for (int k = law->from[m]; k < m; k++)
        for (int d = 0; d < DOFS; d++)
          a[k][d] -= law->L[m][k] * a[m][d];
      for (int d = 0; d < DOFS; d++)
        t[MODE[m][0]][MODE[m][1]][d] = MODE[m][0] < 3 ? -a[m][d] : -0.5 * a[m][d];
    }
    for (int q = 0; q < PAIRS; q++)
      at_points(&t[q][0][0], DOFS);
    for (int q = 0; q < PAIRS; q++)
      for (int p = 0; p < POINTS; p++)
        for (int d = 0; d < DOFS; d++)
          b[q][p][d] += c->ratio[p] * t[q][p][d];
  }
  for (int p = 0; p < POINTS; p++)
    for (int q = 0; q < PAIRS; q++)
      for (int d = 0; d < DOFS; d++)
        out[p][q][d] = q < 3 ? b[q][p][d] : 2.0 * b[q][p][d];
}

/* Pᵀ S, in place. */
static void project_stress(const cell_t *c, const law_t *law, double S[POINTS][PAIRS])
{
  double s[PAIRS][POINTS], a[MODES];
  for (int q = 0; q < PAIRS; q++) {
    for (int p = 0; p < POINTS; p++)
      s[q][p] = c->ratio[p] * S[p][q];
    walsh(s[q], 1);
  }
  for (int m = 0; m < MODES; m++)
    a[m] = s[MODE[m][0]][MODE[m][1]];
  solve(law, a);
  memset(s, 0, sizeof s);
  for (int m = 0; m < MODES; m++)
    for (int q = 0; q < PAIRS; q++)
      s[q][MODE[m][1]] += fabs(c->j0) / POINTS * law->C[MODE[m][0]][q] * a[m];
  for (int q = 0; q < PAIRS; q++) {
    at_points(s[q], 1);
    for (int p = 0; p < POINTS; p++)
      S[p][q] -= s[q][p];
  }
}

/* Adds what stresses do as the rows turn: to the blocks of equal directions. */
static void add_turning_of(const cell_t *c, double S[POINTS][PAIRS], double factor, double *A)
{
  double K[NODES][NODES] = {{0}};
  for (int p = 0; p < POINTS; p++)
    for (int q = 0; q < PAIRS; q++) {
      const double *one = c->dN[p][PAIR[q][0]], *other = c->dN[p][PAIR[q][1]];
      const double f = q < 3 ? 0.5 * S[p][q] : S[p][q];
      for (int m = 0; m < NODES; m++)
        for (int n = 0; n < NODES; n++)
          K[m][n] += f * (one[m] * other[n] + other[m] * one[n]);
    }
  for (int m = 0; m < NODES; m++)
    for (int n = 0; n < NODES; n++)
      for (int k = 0; k < 3; k++)
        A[(3 * m + k) * DOFS + 3 * n + k] += factor * K[m][n];
}

/* Forces, or their tangent, of what FFCx's kernel has found; displacements by direction. */
static void enhanced_work(const cell_t *c, const law_t *law, int rank, const double *found,
                          const double *middle, const double *by, double share, double *A)
{
  const int tangent = rank == 2, size = PAIRS + (tangent ? PAIRS * PAIRS : 0);
  response_t r;
  at_points_t left, right;
  for (int p = 0; p < POINTS; p++)
    take_response(found + size * p, tangent, c->K0, fabs(c->j0 / c->ratio[p]) / POINTS, r.S[p],
                  r.C[p]);
  project_stress(c, law, r.S);
  enhanced_rows(c, law, middle, tangent, left);
  if (!tangent) {
    add_forces(r.S, left, A);
    return;
  }
  enhanced_rows(c, law, by, 1, right);
  add_moduli(r.C, left, right, A);
  if (share != 0.0)
    add_turning_of(c, r.S, share, A);
}

/* Assumed strains ------------------------------------------------------------------------------- */

/* D⁻¹ times n columns, in place. */
static void solve_thin(const resist_t *r, int n, double *a)
{
  for (int m = 0; m < ASSUMED; m++)
    for (int d = 0; d < n; d++) {
      for (int k = 0; k < m; k++)
        a[m * n + d] -= r->L[m][k] * a[k * n + d];
      a[m * n + d] *= r->L[m][m];
    }
  for (int m = ASSUMED - 1; m >= 0; m--)
    for (int d = 0; d < n; d++) {
      a[m * n + d] *= r->L[m][m];
      for (int k = 0; k < m; k++)
        a[k * n + d] -= r->L[m][k] * a[m * n + d];
    }
}

/* P B of rows, in place. */
static void project_thin_rows(const thin_t *t, const resist_t *r, at_points_t B)
{
  double a[ASSUMED][DOFS] = {{0}};
  for (int p = 0; p < POINTS; p++)
    for (int q = 0; q < PAIRS; q++)
      for (int m = 0; m < ASSUMED; m++)
        for (int d = 0; d < DOFS; d++)
          a[m][d] += r->CM[p][q][m] * B[p][q][d];
  solve_thin(r, DOFS, &a[0][0]);
  for (int p = 0; p < POINTS; p++)
    for (int q = 0; q < PAIRS; q++)
      for (int m = 0; m < ASSUMED; m++)
        for (int d = 0; d < DOFS; d++)
          B[p][q][d] -= t->M[p][q][m] * a[m][d];
}

/* Pᵀ S, in place. */
static void project_thin_stress(const thin_t *t, const resist_t *r, double S[POINTS][PAIRS])
{
  double a[ASSUMED] = {0};
  for (int p = 0; p < POINTS; p++)
    for (int q = 0; q < PAIRS; q++)
      for (int m = 0; m < ASSUMED; m++)
        a[m] += t->M[p][q][m] * S[p][q];
  solve_thin(r, 1, a);
  for (int p = 0; p < POINTS; p++)
    for (int q = 0; q < PAIRS; q++)
      for (int m = 0; m < ASSUMED; m++)
        S[p][q] -= r->CM[p][q][m] * a[m];
}

/* As `enhanced_work`, of cells with a direction of their thickness. */
static void assumed_work(const thin_t *t, const resist_t *with, int rank, const double *found,
                         const double *middle, const double *by, double share, double *A)
{
  const int tangent = rank == 2, size = PAIRS + (tangent ? PAIRS * PAIRS : 0);
  response_t r;
  at_points_t left, right;
  for (int p = 0; p < POINTS; p++)
    take_response(found + size * p, tangent, t->K[p], t->weight[p], r.S[p], r.C[p]);
  project_thin_stress(t, with, r.S);
  thin_rows(t, middle, left);
  if (!tangent) {
    add_forces(r.S, left, A);
    return;
  }
  thin_rows(t, by, right);
  project_thin_rows(t, with, left);
  project_thin_rows(t, with, right);
  add_moduli(r.C, left, right, A);
  if (share != 0.0)
    add_turning(t, r.S, share, A);
}
