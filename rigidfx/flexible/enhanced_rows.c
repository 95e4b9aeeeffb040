/* What a tangent loses by enhanced strains: see enhanced.c, behind which it stands.

   Rows are derivatives by the displacement of a cell, by direction, then by node. */

/* Derivatives of shape functions at a point, in the frame of the centre. */
static inline void node_slopes(const cell_t *c, int p, eight_t dN[3])
{
  for (int i = 0; i < 3; i++)
    for (int s = 0; s < PARTS; s++)
      dN[i].part[s] = c->H[0][i].at[p] * slopes[p][0].part[s]
                      + c->H[1][i].at[p] * slopes[p][1].part[s]
                      + c->H[2][i].at[p] * slopes[p][2].part[s];
}

/* Derivatives of strains at the points, in the frame of the centre. */
static void rows(const cell_t *c, const double *u, row_t b[PAIRS][POINTS])
{
  eight_t h[3][3], dN[3];
  for (int s = 0; s < PARTS; s++) {
    part_t g[3][3];
    gradient(c, u, s, g);
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        h[i][k].part[s] = 0.5 * (g[i][k] + c->J0[k][i]);
  }
  for (int p = 0; p < POINTS; p++) {
    node_slopes(c, p, dN);
    for (int q = 0; q < PAIRS; q++) {
      const int i = PAIR[q][0], j = PAIR[q][1];
      for (int k = 0; k < 3; k++)
        for (int s = 0; s < PARTS; s++)
          b[q][p].by[k].part[s] =
            h[i][k].at[p] * dN[j].part[s] + h[j][k].at[p] * dN[i].part[s];
    }
  }
}

/* L⁻¹ B: how the modes' right sides change with the displacement, from rows, which are transformed
   in place. */
static void modes_of_rows(const cell_t *c, const law_t *law, row_t b[PAIRS][POINTS],
                          row_t B[MODES])
{
  const double w = fabs(c->j0) / POINTS;
  for (int q = 0; q < PAIRS; q++)
    for (int bit = 1; bit < POINTS; bit *= 2)
      for (int p = 0; p < POINTS; p++)
        for (int k = 0; k < ROW && !(p & bit); k++) {
          const part_t low = b[q][p].part[k], high = b[q][p | bit].part[k];
          b[q][p].part[k] = low + high;
          b[q][p | bit].part[k] = high - low;
        }
  for (int m = 0; m < MODES; m++) {
    part_t s[ROW] = {{0}};
    for (int q = 0; q < PAIRS; q++)
      for (int k = 0; k < ROW; k++)
        s[k] += (q < 3 ? w : 2.0 * w) * law->C[MODE[m][0]][q] * b[q][MODE[m][1]].part[k];
    for (int n = law->apart ? FROM[m] : 0; n < m; n++)
      for (int k = 0; k < ROW; k++)
        s[k] -= law->U[n].at[m] * law->d[n] * B[n].part[k];
    memcpy(B[m].part, s, sizeof s);
  }
}

static void coupling(const cell_t *c, const law_t *law, const double *u, row_t B[MODES])
{
  row_t b[PAIRS][POINTS];
  rows(c, u, b);
  modes_of_rows(c, law, b, B);
}

/* Adds leftᵀ right, of n rows each. */
static void add_product(int n, const row_t *left, const row_t *right, double *A)
{
  enum { TOGETHER = W == 8 ? 3 : 1 };  /* as many as there are registers for */
  for (int i = 0; i < DOFS; i += TOGETHER) {
    union {
      part_t part[TOGETHER][ROW];
      row_t row[TOGETHER];
    } K = {{{{0}}}};
    for (int m = 0; m < n; m++)
      for (int j = 0; j < TOGETHER; j++)
        for (int k = 0; k < ROW; k++)
          K.part[j][k] += left[m].at[i + j] * right[m].part[k];
    for (int j = 0; j < TOGETHER; j++) {
      double *row = A + (3 * ((i + j) % NODES) + (i + j) / NODES) * DOFS;
      for (int k = 0; k < 3; k++)
        for (int m = 0; m < NODES; m++)
          row[3 * m + k] += K.row[j].by[k].at[m];
    }
  }
}

/* Takes factor leftᵀ d right off a matrix. */
static void subtract(const law_t *law, double *A, const row_t left[MODES], const row_t right[MODES],
                     double factor)
{
  row_t scaled[MODES];
  for (int m = 0; m < MODES; m++)
    for (int k = 0; k < ROW; k++)
      scaled[m].part[k] = -factor * law->d[m] * right[m].part[k];
  add_product(MODES, left, scaled, A);
}
