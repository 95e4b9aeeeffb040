/* Kernels round those of FFCx, which read the enhancement of a strain as if it were a coefficient:
   see elimination.py.

   Before FFCx's kernel is called, the enhancement is computed from the displacements (enhanced.c, or
   assumed.c for cells with a direction of their thickness) and written in the coefficient's place; a
   tangent then loses what elimination costs it. Forces and tangents of assumed strains need no
   kernel of FFCx; those of stresses that are no linear function of strains one for the stress alone
   (projected.c). */

enum { SLOTS = 1024 };
enum { MOVES = 4, STRAINS = 8, BLOCKS = 4, PORTIONS = 8, WORKS = 4, READS = 16, LARGEST = 1024 };

typedef void kernel_t(double *, const double *, const double *, const double *, const int *,
                      const uint8_t * KERNEL_EXTRA_TYPE);

/* A stress that is no linear function of strains. Its kernel reads values one after the other that
   stand elsewhere in the form's. */
typedef struct {
  void *kernel;
  int reads, read_from[READS], read_size[READS];            /* coefficients, */
  int constants, constant_from[READS], constant_size[READS];  /* and constants */
  int law;                  /* of which enhancement, */
  double middle[MOVES];     /* the sum of displacements at which it does work, */
  int by;                   /* and the displacement of the derivative */
} work_t;

/* Where a kernel finds what it needs: numbers are places among coefficients or constants. */
typedef struct {
  void *kernel;             /* FFCx's; none if it would find nothing */
  int size;                 /* of the coefficients of a cell */
  int moves;                /* how many displacements there are, */
  int place[MOVES];         /* and where */
  int strains;              /* how many enhancements the kernel reads, */
  int at[STRAINS];          /* where; */
  int source[STRAINS];      /* where λ, μ and the thickness are, in the place of their kind's first; */
  int end[STRAINS];         /* each that of a displacement, */
  int start[STRAINS];       /* less that of another one, if this is not -1 */
  int blocks;               /* how many blocks the kernel's matrix loses: */
  int law[BLOCKS];          /* by λ and μ of which enhancement, */
  double left[BLOCKS][MOVES];   /* about which sums of displacements on the left */
  double right[BLOCKS][MOVES];  /* and on the right, */
  double factor[BLOCKS];    /* times a factor */
  int more[BLOCKS];         /* and the constant that is added to it, -1 if none */
  int rank;                 /* of the form: 1 for forces, 2 for a tangent */
  int portions;             /* how many portions the stress of a form has; 0: it is FFCx's alone */
  int portion_law[PORTIONS];    /* each by λ and μ of which enhancement, */
  int portion_end[PORTIONS];    /* of the strain at a displacement, */
  int portion_start[PORTIONS];  /* less that at another one, if this is not -1, */
  double portion_factor[PORTIONS];  /* times a factor */
  int portion_more[PORTIONS];   /* and the constant that is added to it, -1 if none; */
  double middle[MOVES];     /* the sum of displacements at which it does work, */
  int by;                   /* and the displacement of the derivative */
  int works;                /* how many stresses there are that are not linear */
  work_t work[WORKS];
} closure_t;

closure_t closures[SLOTS];

/* η of cells: their corners, displacements, λ, μ and direction of thickness (0 for none). */
void enhancements(int cells, const double *x, const double *u, const double *law, double *eta)
{
  for (int k = 0; k < cells; k++) {
    const double lambda = law[3 * k], mu = law[3 * k + 1];
    const int axis = (int)law[3 * k + 2] - 1;
    double *to = eta + PAIRS * POINTS * k;
    if (axis < 0) {
      cell_t c;
      law_t of = {.lambda = lambda, .mu = mu};
      part_t a[MODES] = {{0}};
      look_at_cell(x + DOFS * k, &c);
      factorise(&c, &of);
      add_right_side(&c, &of, 0, u + DOFS * k, 0, a);
      solve(&of, a);
      write_enhancement(&c, a, 0, to);
    } else {
      thin_t t;
      resist_t r;
      look_at_thin(x + DOFS * k, axis, &t);
      resist(&t, lambda, mu, &r);
      enhance_thin(&t, &r, 0, u + DOFS * k, to);
    }
  }
}

/* A sum of displacements. */
static void mean(const closure_t *o, const double *weight, const double *w, double *u)
{
  memset(u, 0, DOFS * sizeof *u);
  for (int s = 0; s < o->moves; s++)
    for (int d = 0; d < DOFS && weight[s] != 0.0; d++)
      u[d] += weight[s] * w[o->place[s] + d];
}

/* Where the displacement at an enhancement's or a portion's start is; null if it has none. */
static const double *start_of(const closure_t *o, int start, const double *w)
{
  return start < 0 ? 0 : w + o->place[start];
}

static double with_more(double factor, int more, const double *c)
{
  return factor + (more < 0 ? 0.0 : c[more]);
}

/* Forces, or their tangent, of assumed strains: Σ leftᵀ S. */
static void thin_work(const closure_t *o, const thin_t *t, double *A, const double *w,
                      const double *c)
{
  double S[POINTS][PAIRS] = {{0}}, u[DOFS];
  double left[POINTS][PAIRS][DOFS], right[POINTS][PAIRS][DOFS];
  mean(o, o->middle, w, u);
  thin_rows(t, u, left);
  if (o->rank == 2) {
    double one[MOVES] = {0};
    one[o->by] = 1.0;
    mean(o, one, w, u);
    thin_rows(t, u, right);
  }
  for (int k = 0; k < o->portions; k++) {
    double E[POINTS][PAIRS], compatible[POINTS][PAIRS];
    resist_t r;
    const double *law = w + o->source[o->portion_law[k]];
    const double factor = with_more(o->portion_factor[k], o->portion_more[k], c);
    resist(t, law[0], law[1], &r);
    thin_strains(t, start_of(o, o->portion_start[k], w), w + o->place[o->portion_end[k]], E,
                 compatible);
    add_modes(t, &r, E);
    for (int p = 0; p < POINTS; p++)
      for (int a = 0; a < PAIRS; a++)
        for (int b = 0; b < PAIRS; b++)
          S[p][a] += factor * r.C[p][a][b] * E[p][b];
    if (o->rank == 2 && o->portion_end[k] == o->by)
      add_stiffness(&r, left, right, factor, A);
  }
  if (o->rank == 2) {
    if (o->middle[o->by] != 0.0)
      add_turning(t, S, o->middle[o->by], A);
    return;
  }
  for (int p = 0; p < POINTS; p++)
    for (int a = 0; a < PAIRS; a++)
      for (int d = 0; d < DOFS; d++)
        A[3 * (d % NODES) + d / NODES] += S[p][a] * left[p][a][d];
}

static void gather(int n, const int *from, const int *size, const double *of, double *to)
{
  for (int k = 0; k < n; to += size[k++])
    memcpy(to, of + from[k], size[k] * sizeof *to);
}

/* What is found at the points for a stress that is not linear, and the displacements that its work
   depends on. */
typedef struct {
  double found[POINTS * PAIRS * (PAIRS + 1)], middle[DOFS], by[DOFS], share;
} found_t;

static void look_at_work(const closure_t *o, const work_t *k, const double *w, const double *c,
                         const double *x, const int *entity, const uint8_t *turned,
                         found_t *f KERNEL_EXTRA)
{
  double coefficients[LARGEST], constants[LARGEST], one[MOVES] = {0};
  gather(k->reads, k->read_from, k->read_size, w, coefficients);
  gather(k->constants, k->constant_from, k->constant_size, c, constants);
  memset(f->found, 0, sizeof f->found);
  ((kernel_t *)k->kernel)(f->found, coefficients, constants, x, entity, turned KERNEL_EXTRA_NAME);
  one[k->by] = 1.0;
  mean(o, k->middle, w, f->middle);
  mean(o, one, w, f->by);
  f->share = k->middle[k->by];
}

/* A kernel of cells with a direction of their thickness. */
static void assumed(const closure_t *o, int axis, double *A, const double *w, const double *c,
                    const double *x, const int *entity, const uint8_t *turned KERNEL_EXTRA)
{
  double v[LARGEST];
  thin_t t;
  look_at_thin(x, axis, &t);
  if (o->portions)
    thin_work(o, &t, A, w, c);
  if (o->portions && !o->works)
    return;
  memcpy(v, w, o->size * sizeof *v);
  for (int s = 0; s < o->strains; s++) {
    resist_t r;
    resist(&t, w[o->source[s]], w[o->source[s] + 1], &r);
    enhance_thin(&t, &r, start_of(o, o->start[s], w), w + o->place[o->end[s]], v + o->at[s]);
  }
  if (!o->portions && o->kernel)
    ((kernel_t *)o->kernel)(A, v, c, x, entity, turned KERNEL_EXTRA_NAME);
  for (int k = 0; k < o->works; k++) {
    const double *law = w + o->source[o->work[k].law];
    resist_t r;
    found_t f;
    resist(&t, law[0], law[1], &r);
    look_at_work(o, &o->work[k], v, c, x, entity, turned, &f KERNEL_EXTRA_NAME);
    assumed_work(&t, &r, o->rank, f.found, f.middle, f.by, f.share, A);
  }
}

/* Enhancements that a kernel reads, in the place of coefficients v: those of a law W at a time. */
static void enhance(const closure_t *o, const cell_t *cell, const double *w, law_t *law, int *of,
                    double *v)
{
  int laws = 0;
  for (int s = 0; s < o->strains; s++) {
    const double lambda = w[o->source[s]], mu = w[o->source[s] + 1];
    for (of[s] = 0; of[s] < laws; of[s]++)
      if (law[of[s]].lambda == lambda && law[of[s]].mu == mu)
        break;
    if (of[s] == laws) {
      law[laws].lambda = lambda;
      law[laws].mu = mu;
      factorise(cell, &law[laws++]);
    }
  }
  for (int k = 0; k < laws; k++)
    for (int s = 0, last; s < o->strains; s = last) {
      part_t a[MODES] = {{0}};
      int columns = 0;
      for (last = s; last < o->strains && columns < W; last++)
        if (of[last] == k)
          add_right_side(cell, &law[k], start_of(o, o->start[last], w),
                         w + o->place[o->end[last]], columns++, a);
      if (columns)
        solve(&law[k], a);
      for (columns = 0; s < last; s++)
        if (of[s] == k)
          write_enhancement(cell, a, columns++, v + o->at[s]);
    }
}

static void eliminated(const closure_t *o, double *A, const double *w, const double *c,
                       const double *x, const int *entity, const uint8_t *turned KERNEL_EXTRA)
{
  const int axis = (int)w[o->source[0] + 2] - 1;
  if (axis >= 0) {
    assumed(o, axis, A, w, c, x, entity, turned KERNEL_EXTRA_NAME);
    return;
  }
  double v[LARGEST];
  cell_t cell;
  law_t law[STRAINS];
  int of[STRAINS];
  memcpy(v, w, o->size * sizeof *v);
  look_at_cell(x, &cell);
  enhance(o, &cell, w, law, of, v);
  if (o->kernel)
    ((kernel_t *)o->kernel)(A, v, c, x, entity, turned KERNEL_EXTRA_NAME);
  for (int b = 0; b < o->blocks; b++) {
    double u[DOFS];
    row_t left[MODES], right[MODES];
    const law_t *with = &law[of[o->law[b]]];
    const int same = !memcmp(o->left[b], o->right[b], sizeof o->left[b]);
    mean(o, o->right[b], w, u);
    coupling(&cell, with, u, right);
    if (!same) {
      mean(o, o->left[b], w, u);
      coupling(&cell, with, u, left);
    }
    subtract(with, A, same ? right : left, right, with_more(o->factor[b], o->more[b], c));
  }
  for (int k = 0; k < o->works; k++) {
    found_t f;
    look_at_work(o, &o->work[k], v, c, x, entity, turned, &f KERNEL_EXTRA_NAME);
    enhanced_work(&cell, &law[of[o->work[k].law]], o->rank, f.found, f.middle, f.by, f.share, A);
  }
}

/* A kernel has no data of its own in DOLFINx: each slot is a function that knows its closure. */
#define SLOT(n)                                                                                    \
  static void slot_##n(double *A, const double *w, const double *c, const double *x,               \
                       const int *entity, const uint8_t *turned KERNEL_EXTRA)                      \
  {                                                                                                \
    eliminated(&closures[n], A, w, c, x, entity, turned KERNEL_EXTRA_NAME);                        \
  }
