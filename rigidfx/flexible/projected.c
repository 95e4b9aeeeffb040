/* Forces of stresses that are no linear function of strains: see mechanics/enhanced.py. It stands
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

/* Pᵀ S, in place. */
static void project_stress(const cell_t *c, const law_t *law, eight_t S[PAIRS])
{
  eight_t t[PAIRS];
  part_t a[MODES] = {{0}};
  for (int q = 0; q < PAIRS; q++) {
    for (int s = 0; s < PARTS; s++)
      t[q].part[s] = c->ratio.part[s] * S[q].part[s];
    transform(signs, &t[q]);
  }
  for (int m = 0; m < MODES; m++)
    a[m][0] = t[MODE[m][0]].at[MODE[m][1]];
  solve(law, a);
  memset(t, 0, sizeof t);
  for (int m = 0; m < MODES; m++)
    t[MODE[m][0]].at[MODE[m][1]] = fabs(c->j0) / POINTS * a[m][0];
  for (int q = 0; q < PAIRS; q++) {
    eight_t less = {{0}};
    for (int b = 0; b < PAIRS; b++)
      for (int s = 0; s < PARTS; s++)
        less.part[s] += law->C[b][q] * t[b].part[s];
    transform(signs_at, &less);
    for (int s = 0; s < PARTS; s++)
      S[q].part[s] -= less.part[s];
  }
}

/* Adds Σ Bᵀ S, B at a displacement: F S, and the nodes' slopes. */
static void add_forces_of(const cell_t *c, const double *u, const eight_t S[PAIRS], double *A)
{
  eight_t g[3][3], f[3] = {{{0}}};
  for (int s = 0; s < PARTS; s++) {
    part_t F[3][3], FS[3][3] = {{{0}}};
    gradient(c, u, s, F);
    for (int q = 0; q < PAIRS; q++)
      for (int k = 0; k < 3; k++) {
        const int i = PAIR[q][0], j = PAIR[q][1];
        FS[i][k] += S[q].part[s] * (F[j][k] + c->J0[k][j]);
        if (i != j)
          FS[j][k] += S[q].part[s] * (F[i][k] + c->J0[k][i]);
      }
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        g[i][k].part[s] = c->H[i][0].part[s] * FS[0][k] + c->H[i][1].part[s] * FS[1][k]
                          + c->H[i][2].part[s] * FS[2][k];
  }
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++)
      for (int p = 0; p < POINTS; p++)
        for (int s = 0; s < PARTS; s++)
          f[k].part[s] += g[i][k].at[p] * slopes[p][i].part[s];
  for (int n = 0; n < NODES; n++)
    for (int k = 0; k < 3; k++)
      A[3 * n + k] += f[k].at[n];
}

/* P B at a displacement, shears twice. */
static void enhanced_rows(const cell_t *c, const law_t *law, const double *u,
                          row_t out[POINTS][PAIRS])
{
  row_t b[PAIRS][POINTS], t[PAIRS][POINTS], a[MODES];
  rows(c, u, b);
  memcpy(t, b, sizeof t);
  modes_of_rows(c, law, t, a);
  memset(t, 0, sizeof t);
  for (int m = MODES - 1; m >= 0; m--) {  /* D⁻¹, of which L⁻¹ is done */
    const int below = law->apart ? BELOW[m] : MODES;
    for (int n = m + 1; n < below; n++)
      for (int k = 0; k < ROW; k++)
        a[m].part[k] -= law->U[m].at[n] * a[n].part[k];
    for (int k = 0; k < ROW; k++) {
      a[m].part[k] *= law->d[m];
      t[MODE[m][0]][MODE[m][1]].part[k] = (MODE[m][0] < 3 ? -1.0 : -0.5) * a[m].part[k];
    }
  }
  for (int q = 0; q < PAIRS; q++) {
    for (int bit = 1; bit < POINTS; bit *= 2)
      for (int p = 0; p < POINTS; p++)
        for (int k = 0; k < ROW && !(p & bit); k++) {
          const part_t one = t[q][p].part[k], product = t[q][p | bit].part[k];
          t[q][p].part[k] = one - product;
          t[q][p | bit].part[k] = one + product;
        }
    for (int p = 0; p < POINTS; p++)
      for (int k = 0; k < ROW; k++)
        out[p][q].part[k] =
          (q < 3 ? 1.0 : 2.0) * (b[q][p].part[k] + c->ratio.at[p] * t[q][p].part[k]);
  }
}

/* ∂S/∂Ẽ of the frame at the points but for their weights, from what FFCx's kernel has found. */
static void moduli(const double *found, double Q[PAIRS][PAIRS], eight_t C[PAIRS][PAIRS])
{
  eight_t half[PAIRS][PAIRS] = {{{{0}}}}, value;
  for (int c = 0; c < PAIRS; c++)
    for (int b = 0; b < PAIRS; b++) {
      for (int p = 0; p < POINTS; p++)
        value.at[p] = found[PAIRS * (PAIRS + 1) * p + PAIRS * (c + 1) + b];
      for (int a = 0; a < PAIRS; a++)
        for (int s = 0; s < PARTS; s++)
          half[a][b].part[s] += Q[a][c] * value.part[s];
    }
  for (int a = 0; a < PAIRS; a++)
    for (int b = 0; b < PAIRS; b++)
      for (int s = 0; s < PARTS; s++) {
        part_t sum = {0};
        for (int c = 0; c < PAIRS; c++)
          sum += half[a][c].part[s] * Q[b][c];
        C[a][b].part[s] = sum;
      }
}

/* Adds what stresses do as the rows turn: to the blocks of equal directions. */
static void add_turning_of(const cell_t *c, const eight_t S[PAIRS], double factor, double *A)
{
  eight_t K[NODES] = {{{0}}}, dN[3];
  for (int p = 0; p < POINTS; p++) {
    node_slopes(c, p, dN);
    for (int q = 0; q < PAIRS; q++) {
      const int i = PAIR[q][0], j = PAIR[q][1];
      const double f = (i == j ? 0.5 : 1.0) * factor * S[q].at[p];
      for (int m = 0; m < NODES; m++)
        for (int s = 0; s < PARTS; s++)
          K[m].part[s] += f * (dN[i].at[m] * dN[j].part[s] + dN[j].at[m] * dN[i].part[s]);
    }
  }
  for (int m = 0; m < NODES; m++)
    for (int n = 0; n < NODES; n++)
      for (int k = 0; k < 3; k++)
        A[(3 * m + k) * DOFS + 3 * n + k] += K[m].at[n];
}

/* Forces, or their tangent, of what FFCx's kernel has found. */
static void enhanced_work(const cell_t *c, const law_t *law, int rank, const double *found,
                          const double *middle, const double *by, double share, double *A)
{
  const int tangent = rank == 2, size = PAIRS + (tangent ? PAIRS * PAIRS : 0);
  double Q[PAIRS][PAIRS];
  eight_t weight, value, S[PAIRS] = {{{0}}}, C[PAIRS][PAIRS];
  row_t left[POINTS][PAIRS], right[POINTS][PAIRS], response[POINTS][PAIRS];
  turn_stress(c->K0, Q);
  for (int s = 0; s < PARTS; s++)
    weight.part[s] = fabs(c->j0) / POINTS / c->ratio.part[s];
  for (int b = 0; b < PAIRS; b++) {
    for (int p = 0; p < POINTS; p++)
      value.at[p] = weight.at[p] * found[size * p + b];
    for (int a = 0; a < PAIRS; a++)
      for (int s = 0; s < PARTS; s++)
        S[a].part[s] += Q[a][b] * value.part[s];
  }
  project_stress(c, law, S);
  if (!tangent) {
    add_forces_of(c, middle, S, A);
    return;
  }
  moduli(found, Q, C);
  enhanced_rows(c, law, middle, left);
  enhanced_rows(c, law, by, right);
  memset(response, 0, sizeof response);
  for (int p = 0; p < POINTS; p++)
    for (int a = 0; a < PAIRS; a++)
      for (int b = 0; b < PAIRS; b++)
        for (int k = 0; k < ROW; k++)
          response[p][a].part[k] += weight.at[p] * C[a][b].at[p] * right[p][b].part[k];
  add_product(POINTS * PAIRS, left[0], response[0], A);
  if (share != 0.0)
    add_turning_of(c, S, share, A);
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
