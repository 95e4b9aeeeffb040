/* Enhanced strains of 8-node hexahedra, eliminated within a cell: see elimination.py.

   The enhancement η = M α of the strain at the eight points of a Gauss rule is found from the
   displacement,

       D α = -e(u),   e = ∫ M : ℂ : E(u) dV,   D = ∫ M : ℂ : M dV,

   and a tangent loses f B(u_l)ᵀ D⁻¹ B(u_r), B = ∂e/∂u.

   All of it is done in the frame of the cell's centre, Ê = J₀ᵀ E J₀, where M is (j₀/j) times unit
   tensors times products of ±1, so that sums over the points are sums and differences only: a Walsh
   transform. Numbers of nodes and of points are 4 x + 2 y + z and x + 2 y + 4 z, bits being
   coordinates; a product of coordinates has the number of the bits that are in it. There are eight
   of each, and what is alike for all eight is computed at once. */

#include <math.h>
#include <stdint.h>
#include <string.h>

/* How many numbers this processor computes with at once, W, and how often that is eight. */
#ifdef __AVX512F__
enum { W = 8 };
#elif defined(__AVX__)
enum { W = 4 };
#else
enum { W = 2 };
#endif
enum { PARTS = 8 / W };
typedef double part_t __attribute__((vector_size(W * sizeof(double))));

/* A number for each point, node or product. */
typedef union {
  double at[8];
  part_t part[PARTS];
} eight_t;

enum { NODES = 8, DOFS = 24, POINTS = 8, PAIRS = 6, MODES = 21, ROW = DOFS / W };
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
static const int ALL_BELOW[MODES] = {
  21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21, 21};

/* What is known of a cell before anything moves. */
typedef struct {
  double J0[3][3], K0[3][3], j0;  /* J at the centre, its inverse and determinant */
  eight_t ratio;                  /* j₀/j at the points */
  eight_t H[3][3];                /* J⁻¹ J₀ at the points */
} cell_t;

/* A number for each dof of a cell, or for each mode and some more. */
typedef union {
  double at[DOFS];
  part_t part[ROW];
  eight_t by[3];
} row_t;

/* ℂ in that frame and the factors of D = L U, L = Uᵀ d, for λ and μ. */
typedef struct {
  double lambda, mu;
  double C[PAIRS][PAIRS];  /* of components ij and kl */
  int apart;               /* whether D couples modes of the same product only */
  double d[MODES];         /* one over U's diagonal */
  row_t U[MODES];          /* before the diagonal, whatever was left */
} law_t;

/* Inverse of a matrix of numbers of a kind, and its determinant. */
#define INVERSE(name, number_t)                                                                    \
  static inline void name(const number_t A[3][3], number_t B[3][3], number_t *det)                 \
  {                                                                                                \
    B[0][0] = A[1][1] * A[2][2] - A[1][2] * A[2][1];                                               \
    B[0][1] = A[0][2] * A[2][1] - A[0][1] * A[2][2];                                               \
    B[0][2] = A[0][1] * A[1][2] - A[0][2] * A[1][1];                                               \
    B[1][0] = A[1][2] * A[2][0] - A[1][0] * A[2][2];                                               \
    B[1][1] = A[0][0] * A[2][2] - A[0][2] * A[2][0];                                               \
    B[1][2] = A[0][2] * A[1][0] - A[0][0] * A[1][2];                                               \
    B[2][0] = A[1][0] * A[2][1] - A[1][1] * A[2][0];                                               \
    B[2][1] = A[0][1] * A[2][0] - A[0][0] * A[2][1];                                               \
    B[2][2] = A[0][0] * A[1][1] - A[0][1] * A[1][0];                                               \
    *det = A[0][0] * B[0][0] + A[0][1] * B[1][0] + A[0][2] * B[2][0];                              \
    const number_t factor = 1.0 / *det;                                                            \
    for (int i = 0; i < 3; i++)                                                                    \
      for (int j = 0; j < 3; j++)                                                                  \
        B[i][j] *= factor;                                                                         \
  }

INVERSE(inverse, double)
INVERSE(inverses, part_t)

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

static eight_t slopes[POINTS + 1][3];  /* of the nodes, at each point and, last, at the centre */
static eight_t slopes_at[3][NODES];    /* of each node, at the points */
static eight_t signs[POINTS], signs_at[POINTS];  /* of the products at a point, and likewise */

void prepare(void)
{
  const double a = 0.5 - 0.5 / sqrt(3.0);
  for (int p = 0; p <= POINTS; p++) {
    double xi[3] = {0.5, 0.5, 0.5};
    for (int i = 0; i < 3 && p < POINTS; i++)
      xi[i] = p >> (2 - i) & 1 ? 1.0 - a : a;
    for (int i = 0; i < 3; i++)
      for (int n = 0; n < NODES; n++) {
        slopes[p][i].at[n] = slope(n, i, xi);
        if (p < POINTS)
          slopes_at[i][n].at[p] = slopes[p][i].at[n];
      }
  }
  for (int p = 0; p < POINTS; p++)
    for (int k = 0; k < POINTS; k++) {
      double sign = 1.0;
      for (int bit = 1; bit < POINTS; bit *= 2)
        if (k & bit && !(p & bit))
          sign = -sign;
      signs[p].at[k] = signs_at[k].at[p] = sign;
    }
}

static void look_at_cell(const double *x, cell_t *c)
{
  memset(c->J0, 0, sizeof c->J0);
  for (int i = 0; i < 3; i++)
    for (int k = 0; k < 3; k++)
      for (int n = 0; n < NODES; n++)
        c->J0[i][k] += x[3 * n + i] * slopes[POINTS][k].at[n];
  inverse(c->J0, c->K0, &c->j0);
  for (int s = 0; s < PARTS; s++) {
    part_t J[3][3] = {{{0}}}, K[3][3], j;
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        for (int n = 0; n < NODES; n++)
          J[i][k] += x[3 * n + i] * slopes_at[k][n].part[s];
    inverses(J, K, &j);
    c->ratio.part[s] = c->j0 / j;
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        c->H[i][k].part[s] = K[i][0] * c->J0[0][k] + K[i][1] * c->J0[1][k] + K[i][2] * c->J0[2][k];
  }
}

/* Σ v with a table of signs, in place: with `signs`, sums over the points with those of all products
   of coordinates; with `signs_at`, values at the points of a sum of products. */
static inline void transform(const eight_t table[8], eight_t *v)
{
  const eight_t old = *v;
  for (int s = 0; s < PARTS; s++) {
    part_t sum = {0};
    for (int k = 0; k < 8; k++)
      sum += old.at[k] * table[k].part[s];
    v->part[s] = sum;
  }
}

/* ℂ, what D is made of besides, and whether it falls apart. */
static void resistance(const cell_t *c, law_t *law, eight_t *T)
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
  for (int p = 0; p < POINTS; p++)
    T->at[p] = fabs(c->j0) / POINTS * c->ratio.at[p];
  transform(signs, T);
  double most = 0.0;
  for (int k = 1; k < POINTS; k++)
    most = fmax(most, fabs(T->at[k]));
  law->apart = most <= 1e-13 * T->at[0];
}

/* The factors of D, which couples modes with those below a number only. Unrolled, as loops so short
   would take longer to go round than what is in them. */
static inline void factorise_with(law_t *law, const eight_t *T, const int *below)
{
#pragma GCC unroll 21
  for (int m = 0; m < MODES; m++)
#pragma GCC unroll 21
    for (int n = m; n < below[m]; n++)
      law->U[m].at[n] = law->C[MODE[m][0]][MODE[n][0]] * T->at[MODE[m][1] ^ MODE[n][1]];
#pragma GCC unroll 21
  for (int n = 0; n < MODES; n++) {
    law->d[n] = 1.0 / law->U[n].at[n];
#pragma GCC unroll 21
    for (int m = n + 1; m < below[n]; m++) {
      const double f = law->U[n].at[m] * law->d[n];
#pragma GCC unroll 12
      for (int k = m / W; k <= (below[n] - 1) / W; k++)
        law->U[m].part[k] -= f * law->U[n].part[k];
    }
  }
}

static void factorise(const cell_t *c, law_t *law)
{
  eight_t T;
  resistance(c, law, &T);
  memset(law->U, 0, sizeof law->U);
  if (law->apart)
    factorise_with(law, &T, BELOW);
  else
    factorise_with(law, &T, ALL_BELOW);
}

/* The displacement's gradient by coordinates of the frame of the centre, at a part of the points. */
static inline void gradient(const cell_t *c, const double *u, int s, part_t h[3][3])
{
  for (int k = 0; k < 3; k++) {
    part_t g[3] = {{0}};
    for (int i = 0; i < 3; i++)
      for (int n = 0; n < NODES; n++)
        g[i] += u[3 * n + k] * slopes_at[i][n].part[s];
    for (int i = 0; i < 3; i++)
      h[i][k] = c->H[0][i].part[s] * g[0] + c->H[1][i].part[s] * g[1] + c->H[2][i].part[s] * g[2];
  }
}

/* Strains at the points, in the frame of the centre: those at u1 less those at u0, if there is one.

   The difference is that of the middle and the increment, without the rounding of either end. */
static void strains(const cell_t *c, const double *u0, const double *u1, eight_t E[PAIRS])
{
  double middle[DOFS], step[DOFS];
  for (int d = 0; d < DOFS && u0; d++) {
    middle[d] = 0.5 * (u0[d] + u1[d]);
    step[d] = u1[d] - u0[d];
  }
  for (int s = 0; s < PARTS; s++) {
    part_t F[3][3], h[3][3];
    gradient(c, u0 ? step : u1, s, h);
    if (u0)
      gradient(c, middle, s, F);
    for (int i = 0; i < 3; i++)
      for (int k = 0; k < 3; k++)
        F[i][k] = c->J0[k][i] + (u0 ? F[i][k] : 0.5 * h[i][k]);
    for (int b = 0; b < PAIRS; b++) {
      const int i = PAIR[b][0], j = PAIR[b][1];
      part_t sum = {0};
      for (int k = 0; k < 3; k++)
        sum += F[i][k] * h[j][k] + F[j][k] * h[i][k];
      E[b].part[s] = 0.5 * sum;
    }
  }
}

/* D⁻¹ times W columns, in place; see `factorise_with`. */
static inline void solve_with(const law_t *law, part_t a[MODES], const int *below)
{
#pragma GCC unroll 21
  for (int m = 0; m < MODES; m++) {
    const part_t s = a[m] * law->d[m];
#pragma GCC unroll 21
    for (int k = m + 1; k < below[m]; k++)
      a[k] -= law->U[m].at[k] * s;
  }
#pragma GCC unroll 21
  for (int m = MODES - 1; m >= 0; m--) {
    part_t s = {0};
#pragma GCC unroll 21
    for (int k = below[m] - 1; k > m; k--)
      s += law->U[m].at[k] * a[k];
    a[m] = (a[m] - s) * law->d[m];
  }
}

static void solve(const law_t *law, part_t a[MODES])
{
  if (law->apart)
    solve_with(law, a, BELOW);
  else
    solve_with(law, a, ALL_BELOW);
}

/* e(u) of the strain at u1 less that at u0, if there is one, as a column of others. */
static void add_right_side(const cell_t *c, const law_t *law, const double *u0, const double *u1,
                           int column, part_t a[MODES])
{
  const double w = fabs(c->j0) / POINTS;
  eight_t E[PAIRS], S[PAIRS];
  strains(c, u0, u1, E);
  for (int b = 0; b < PAIRS; b++)
    transform(signs, &E[b]);
  for (int b = 0; b < PAIRS; b++)
    for (int s = 0; s < PARTS; s++) {
      part_t sum = {0};
      for (int q = 0; q < PAIRS; q++)
        sum += (q < 3 ? w : 2.0 * w) * law->C[b][q] * E[q].part[s];
      S[b].part[s] = sum;
    }
  for (int m = 0; m < MODES; m++)
    a[m][column] = S[MODE[m][0]].at[MODE[m][1]];
}

/* η at the points of a column of -α: Cartesian components in the order of pairs. */
static void write_enhancement(const cell_t *c, const part_t a[MODES], int column, double *eta)
{
  eight_t E[PAIRS] = {{{0}}};
  for (int m = 0; m < MODES; m++)
    E[MODE[m][0]].at[MODE[m][1]] = MODE[m][0] < 3 ? -a[m][column] : -0.5 * a[m][column];
  for (int b = 0; b < PAIRS; b++) {
    transform(signs_at, &E[b]);
    for (int s = 0; s < PARTS; s++)
      E[b].part[s] *= c->ratio.part[s];
  }
  for (int b = 0; b < PAIRS; b++) {
    const int i = PAIR[b][0], j = PAIR[b][1];
    eight_t out = {{0}};
    for (int q = 0; q < PAIRS; q++) {
      const int k = PAIR[q][0], l = PAIR[q][1];
      double f = c->K0[k][i] * c->K0[l][j];
      if (k != l)
        f += c->K0[l][i] * c->K0[k][j];
      for (int s = 0; s < PARTS; s++)
        out.part[s] += f * E[q].part[s];
    }
    for (int p = 0; p < POINTS; p++)
      eta[p * PAIRS + b] = out.at[p];
  }
}
