/* Enhanced strains of 8-node hexahedra, eliminated within a cell: see elimination.py.

   The enhancement η = M α of the strain at the eight points of a Gauss rule is found from the
   displacement,

       D α = -e(u),   e = ∫ M : ℂ : E(u) dV,   D = ∫ M : ℂ : M dV,

   and a tangent loses f B(u_l)ᵀ D⁻¹ B(u_r), B = ∂e/∂u.

   All of it is done in the frame of the cell's centre, Ê = J₀ᵀ E J₀, where M is (j₀/j) times unit
   tensors times products of ±1, so that sums over the points are sums and differences only: a Walsh
   transform. Numbers of nodes and of points are 4 x + 2 y + z and x + 2 y + 4 z, bits being
   coordinates; a product of coordinates has the number of the bits that are in it. */

#include <math.h>
#include <stdint.h>
#include <string.h>

enum { NODES = 8, DOFS = 24, POINTS = 8, PAIRS = 6, MODES = 21 };
enum { X = 4, Y = 2, Z = 1 };

/* Components ij of pairs, and those of the modes with the product of coordinates of each. */
static const int PAIR[PAIRS][2] = {{0, 0}, {1, 1}, {2, 2}, {0, 1}, {1, 2}, {0, 2}};
static const int MODE[MODES][2] = {
  {0, X}, {3, X}, {5, X}, {1, Y}, {3, Y}, {4, Y}, {2, Z}, {4, Z}, {5, Z},
  {0, X | Y}, {1, X | Y}, {4, X | Y}, {5, X | Y},
  {0, X | Z}, {2, X | Z}, {3, X | Z}, {4, X | Z},
  {1, Y | Z}, {2, Y | Z}, {3, Y | Z}, {5, Y | Z}};

/* The modes of one product, which D couples with no others in a parallelepiped: from, and below. */
static const int FROM[MODES] = {0, 0, 0, 3, 3, 3, 6, 6, 6, 9, 9, 9, 9, 13, 13, 13, 13, 17, 17, 17, 17};
static const int BELOW[MODES] = {
  3, 3, 3, 6, 6, 6, 9, 9, 9, 13, 13, 13, 13, 17, 17, 17, 17, 21, 21, 21, 21};

/* What is known of a cell before anything moves. */
typedef struct {
  double J0[3][3], K0[3][3], j0;  /* J at the centre, its inverse and determinant */
  double ratio[POINTS];           /* j₀/j */
  double dN[POINTS][3][NODES];    /* derivatives of shape functions in the frame of the centre */
} cell_t;

/* ℂ in that frame and the factor of D, for λ and μ. */
typedef struct {
  double lambda, mu;
  double C[PAIRS][PAIRS];          /* of components ij and kl */
  const int *from, *below;         /* of each mode, those that D couples it with */
  double L[MODES][MODES];  /* D = L Lᵀ, with 1/L on the diagonal */
} law_t;

static double inverse(const double A[3][3], double B[3][3])
{
  B[0][0] = A[1][1] * A[2][2] - A[1][2] * A[2][1];
  B[0][1] = A[0][2] * A[2][1] - A[0][1] * A[2][2];
  B[0][2] = A[0][1] * A[1][2] - A[0][2] * A[1][1];
  B[1][0] = A[1][2] * A[2][0] - A[1][0] * A[2][2];
  B[1][1] = A[0][0] * A[2][2] - A[0][2] * A[2][0];
  B[1][2] = A[0][2] * A[1][0] - A[0][0] * A[1][2];
  B[2][0] = A[1][0] * A[2][1] - A[1][1] * A[2][0];
  B[2][1] = A[0][1] * A[2][0] - A[0][0] * A[2][1];
  B[2][2] = A[0][0] * A[1][1] - A[0][1] * A[1][0];
  const double det = A[0][0] * B[0][0] + A[0][1] * B[1][0] + A[0][2] * B[2][0];
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      B[i][j] /= det;
  return det;
}

/* Derivative of the shape function of a node by the coordinate i, all from 0 to 1. */
static double slope(int node, int i, const double xi[3])
{
  double out = 1.0;
  for (int k = 0; k < 3; k++) {
    const int upper = node >> k & 1;
    out *= k == i ? (upper ? 1.0 : -1.0) : (upper ? xi[k] : 1.0 - xi[k]);
  }
  return out;
}

static double slopes[POINTS + 1][3][NODES];  /* the last at the centre */

void prepare(void)
{
  const double a = 0.5 - 0.5 / sqrt(3.0);
  for (int p = 0; p <= POINTS; p++) {
    double xi[3] = {0.5, 0.5, 0.5};
    for (int i = 0; i < 3 && p < POINTS; i++)
      xi[i] = p >> (2 - i) & 1 ? 1.0 - a : a;
    for (int i = 0; i < 3; i++)
      for (int n = 0; n < NODES; n++)
        slopes[p][i][n] = slope(n, i, xi);
  }
}

static void look_at_cell(const double *x, cell_t *c)
{
  double at[3][NODES];
  for (int n = 0; n < NODES; n++)
    for (int i = 0; i < 3; i++)
      at[i][n] = x[3 * n + i];
  for (int p = POINTS; p >= 0; p--) {
    double J[3][3] = {{0}}, K[3][3];
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        for (int n = 0; n < NODES; n++)
          J[i][j] += at[i][n] * slopes[p][j][n];
    if (p == POINTS) {
      memcpy(c->J0, J, sizeof J);
      c->j0 = inverse(J, c->K0);
      continue;
    }
    c->ratio[p] = c->j0 / inverse(J, K);
    double H[3][3] = {{0}};
    for (int i = 0; i < 3; i++)
      for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++)
          H[i][j] += K[i][k] * c->J0[k][j];
    for (int i = 0; i < 3; i++)
      for (int n = 0; n < NODES; n++)
        c->dN[p][i][n] =
          H[0][i] * slopes[p][0][n] + H[1][i] * slopes[p][1][n] + H[2][i] * slopes[p][2][n];
  }
}

/* Sums over the points with the signs of all products of coordinates, in place. */
static void walsh(double *v, int n)
{
  for (int bit = 1; bit < POINTS; bit *= 2)
    for (int p = 0; p < POINTS; p++)
      if (!(p & bit))
        for (int k = 0; k < n; k++) {
          const double low = v[p * n + k], high = v[(p | bit) * n + k];
          v[p * n + k] = low + high;
          v[(p | bit) * n + k] = high - low;
        }
}

/* Values at the points of sums of products of coordinates, n of each, in place. */
static void at_points(double *v, int n)
{
  for (int bit = 1; bit < POINTS; bit *= 2)
    for (int p = 0; p < POINTS; p++)
      if (!(p & bit))
        for (int k = 0; k < n; k++) {
          const double one = v[p * n + k], product = v[(p | bit) * n + k];
          v[p * n + k] = one - product;
          v[(p | bit) * n + k] = one + product;
        }
}

static void factorise(const cell_t *c, law_t *law)
{
  double g[3][3] = {{0}};
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++)
      for (int k = 0; k < 3; k++)
        g[i][j] += c->K0[i][k] * c->K0[j][k];
  for (int a = 0; a < PAIRS; a++)
    for (int b = 0; b < PAIRS; b++) {
      const int i = PAIR[a][0], j = PAIR[a][1], k = PAIR[b][0], l = PAIR[b][1];
      law->C[a][b] = law->lambda * g[i][j] * g[k][l]
                     + law->mu * (g[i][k] * g[j][l] + g[i][l] * g[j][k]);
    }
  double T[POINTS];
  for (int p = 0; p < POINTS; p++)
    T[p] = fabs(c->j0) / POINTS * c->ratio[p];
  walsh(T, 1);
  static const int first[MODES] = {0};
  static const int end[MODES] = {21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21,
                                 21, 21, 21, 21, 21, 21, 21, 21, 21, 21};
  double most = 0.0;
  for (int k = 1; k < POINTS; k++)
    most = fmax(most, fabs(T[k]));
  law->from = most <= 1e-13 * T[0] ? FROM : first;
  law->below = most <= 1e-13 * T[0] ? BELOW : end;
  for (int m = 0; m < MODES; m++)
    for (int n = law->from[m]; n <= m; n++)
      law->L[m][n] = law->C[MODE[m][0]][MODE[n][0]] * T[MODE[m][1] ^ MODE[n][1]];
  for (int n = 0; n < MODES; n++) {
    for (int m = n; m < law->below[n]; m++) {
      double s = law->L[m][n];
      for (int k = law->from[n]; k < n; k++)
        s -= law->L[m][k] * law->L[n][k];
      law->L[m][n] = s;
    }
    const double r = 1.0 / sqrt(law->L[n][n]);
    for (int m = n + 1; m < law->below[n]; m++)
      law->L[m][n] *= r;
    law->L[n][n] = r;
  }
}

/* Rows of modes from transformed strains, n numbers each: factor Σ ℂ Ê. */
static void modes_of(const cell_t *c, const law_t *law, int n,
                     const double *strain, double *out)
{
  const double w = fabs(c->j0) / POINTS;
  for (int m = 0; m < MODES; m++) {
    const double *C = law->C[MODE[m][0]];
    for (int k = 0; k < n; k++)
      out[m * n + k] = 0.0;
    for (int b = 0; b < PAIRS; b++) {
      const double f = (b < 3 ? w : 2.0 * w) * C[b];
      const double *E = strain + (b * POINTS + MODE[m][1]) * n;
      for (int k = 0; k < n; k++)
        out[m * n + k] += f * E[k];
    }
  }
}

/* Columns of the displacement's gradient in the frame of the centre, at a point; u by direction. */
static void gradient(const cell_t *c, const double *u, int p, double h[3][3])
{
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++) {
      double s = 0.0;
      for (int n = 0; n < NODES; n++)
        s += u[NODES * k + n] * c->dN[p][i][n];
      h[i][k] = s;
    }
}

/* Strains at the points, in the frame of the centre: those at u1 less those at u0, if there is one.

   The difference is that of the middle and the increment, without the rounding of either end. */
static void strains(const cell_t *c, const double *u0, const double *u1, double E[PAIRS][POINTS])
{
  double middle[DOFS], step[DOFS];
  for (int k = 0; k < 3; k++)
    for (int n = 0; n < NODES; n++) {
      const int to = NODES * k + n, at = 3 * n + k;
      middle[to] = u0 ? 0.5 * (u0[at] + u1[at]) : u1[at];
      step[to] = u0 ? u1[at] - u0[at] : 0.0;
    }
  for (int p = 0; p < POINTS; p++) {
    double F[3][3], h[3][3];
    gradient(c, middle, p, F);
    if (u0)
      gradient(c, step, p, h);
    else
      memcpy(h, F, sizeof h);
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        F[i][k] = c->J0[k][i] + (u0 ? 1.0 : 0.5) * F[i][k];
    for (int b = 0; b < PAIRS; b++) {
      const int i = PAIR[b][0], j = PAIR[b][1];
      double s = 0.0;
      for (int k = 0; k < 3; k++)
        s += F[i][k] * h[j][k] + F[j][k] * h[i][k];
      E[b][p] = 0.5 * s;
    }
  }
}

/* D⁻¹ times a, in place. */
static void solve(const law_t *law, double *a)
{
  for (int m = 0; m < MODES; m++) {
    for (int k = law->from[m]; k < m; k++)
      a[m] -= law->L[m][k] * a[k];
    a[m] *= law->L[m][m];
  }
  for (int m = MODES - 1; m >= 0; m--) {
    a[m] *= law->L[m][m];
    for (int k = law->from[m]; k < m; k++)
      a[k] -= law->L[m][k] * a[m];
  }
}

/* η at the points: Cartesian components in the order of pairs. */
static void enhance(const cell_t *c, const law_t *law, const double *u0, const double *u1,
                    double *eta)
{
  double E[PAIRS][POINTS], a[MODES];
  strains(c, u0, u1, E);
  for (int b = 0; b < PAIRS; b++)
    walsh(E[b], 1);
  modes_of(c, law, 1, &E[0][0], a);
  solve(law, a);
  double T[PAIRS][POINTS] = {{0}};
  for (int m = 0; m < MODES; m++)  /* -α is what has been solved for */
    T[MODE[m][0]][MODE[m][1]] = MODE[m][0] < 3 ? -a[m] : -0.5 * a[m];
  for (int b = 0; b < PAIRS; b++) {
    at_points(T[b], 1);
    for (int p = 0; p < POINTS; p++)
      T[b][p] *= c->ratio[p];
  }
  for (int b = 0; b < PAIRS; b++) {
    const int i = PAIR[b][0], j = PAIR[b][1];
    double out[POINTS] = {0};
    for (int q = 0; q < PAIRS; q++) {
      const int k = PAIR[q][0], l = PAIR[q][1];
      double f = c->K0[k][i] * c->K0[l][j];
      if (k != l)
        f += c->K0[l][i] * c->K0[k][j];
      for (int p = 0; p < POINTS; p++)
        out[p] += f * T[q][p];
    }
    for (int p = 0; p < POINTS; p++)
      eta[p * PAIRS + b] = out[p];
  }
}

/* Derivatives of strains at the points by the displacement, in the frame of the centre; u and columns
   by direction, then by node. */
static void rows(const cell_t *c, const double *u, double b[PAIRS][POINTS][DOFS])
{
  for (int p = 0; p < POINTS; p++) {
    double h[3][3];
    gradient(c, u, p, h);
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        h[i][k] += c->J0[k][i];
    for (int q = 0; q < PAIRS; q++) {
      const int i = PAIR[q][0], j = PAIR[q][1];
      for (int k = 0; k < 3; k++)
        for (int n = 0; n < NODES; n++)
          b[q][p][NODES * k + n] = 0.5 * (h[i][k] * c->dN[p][j][n] + h[j][k] * c->dN[p][i][n]);
    }
  }
}

/* L⁻¹ B: how the modes' right sides change with the displacement, shape (21, 24), from rows, which
   are transformed in place. */
static void modes_of_rows(const cell_t *c, const law_t *law, double b[PAIRS][POINTS][DOFS],
                          double *B)
{
  for (int q = 0; q < PAIRS; q++)
    walsh(&b[q][0][0], DOFS);
  modes_of(c, law, DOFS, &b[0][0][0], B);
  for (int m = 0; m < MODES; m++) {
    for (int k = law->from[m]; k < m; k++) {
      const double l = law->L[m][k];
      for (int d = 0; d < DOFS; d++)
        B[m * DOFS + d] -= l * B[k * DOFS + d];
    }
    for (int d = 0; d < DOFS; d++)
      B[m * DOFS + d] *= law->L[m][m];
  }
}

static void coupling(const cell_t *c, const law_t *law, const double *u, double *B)
{
  double b[PAIRS][POINTS][DOFS];
  rows(c, u, b);
  modes_of_rows(c, law, b, B);
}

static void subtract(double *A, const double *left, const double *right, double factor)
{
  for (int i = 0; i < DOFS; i++) {
    double K[DOFS] = {0};
    for (int m = 0; m < MODES; m++) {
      const double l = left[m * DOFS + i];
      for (int j = 0; j < DOFS; j++)
        K[j] += l * right[m * DOFS + j];
    }
    double *row = A + (3 * (i % NODES) + i / NODES) * DOFS;
    for (int k = 0; k < 3; k++)
      for (int n = 0; n < NODES; n++)
        row[3 * n + k] -= factor * K[NODES * k + n];
  }
}
