/* A trial step of bodies some of which deform by m shapes, one body after another: see
   shaped_step.py and shapes.py, which have the equations. It comes behind body_step.c.

   Arrays begin with an axis over all bodies, or over those with shapes, `some` of them, which
   are the bodies `at`. Matrices are stored row by row. */

static void product_by_transposed(const double *A, const double *B, double *C)
{
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      C[3 * i + j] = A[3 * i] * B[3 * j] + A[3 * i + 1] * B[3 * j + 1] + A[3 * i + 2] * B[3 * j + 2];
}

static double dot(int n, const double *a, const double *b)
{
  double sum = 0;
  for (int i = 0; i < n; ++i)
    sum += a[i] * b[i];
  return sum;
}

/* Σ aᵢ × bᵢ from Σ aᵢ bᵢᵀ. */
static void axial(const double *B, double *a)
{
  a[0] = B[5] - B[7];
  a[1] = B[6] - B[2];
  a[2] = B[1] - B[3];
}

/* C with a·δJ b = C : δY for J = tr Y - Y. */
static void contracted(const double *a, const double *b, double *C)
{
  const double both = dot(3, a, b);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      C[3 * i + j] = (i == j) * both - 0.5 * (a[i] * b[j] + a[j] * b[i]);
}

/* R of a body at the start of the step. */
static void rotation(const double *pose, double *R)
{
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      R[3 * i + j] = pose[3 + 3 * j + i];
}

/* first + Σ x_k A_k of n matrices of nine numbers. */
static void summed(int n, const double *x, const double *A, const double *first, double *out)
{
  for (int i = 0; i < 9; ++i)
    out[i] = first ? first[i] : 0;
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < 9; ++i)
      out[i] += x[k] * A[9 * k + i];
}

/* Ω⁻¹Γ q of one body, shape (m, m). */
static void slopes(int m, const double *relieved, const double *q, double *out)
{
  for (int i = 0; i < m * m; ++i)
    out[i] = dot(m, relieved + (size_t)m * i, q);
}

/* Numbers of a body with shapes after a trial; `places` of shaped_step.py has their order. */
struct told {
  double *q1, *S, *de, *elastic, *middle, *stress, *W1, *rates1, *E1, *half;
};

static struct told told_of(const struct shaped *s, double *all)
{
  const int n = s->some, m = s->m;
  struct told t;
  t.q1 = all;
  t.S = t.q1 + n * m;
  t.de = t.S + n * 9;
  t.elastic = t.de + n * m;
  t.middle = t.elastic + n * m;
  t.stress = t.middle + n * m;
  t.W1 = t.stress + n * m;
  t.rates1 = t.W1 + n * 3;
  t.E1 = t.rates1 + n * m;
  t.half = t.E1 + n * 9 * (m + 1);
  return t;
}

/* (p₁ - p₀)/Δt - ½ w₁·∂A/∂q w₀, and `turning`, which shapes add to J W. */
static void inertia_of(const struct shaped *s, int k, struct told t, double *turning, double *out)
{
  const int m = s->m, b = s->at[k];
  const double *q1 = t.q1 + m * k, *W = t.W1 + 3 * k, *rates = t.rates1 + m * k,
               *E = t.E1 + 9 * (m + 1) * k, *half = t.half + 9 * (m + 1) * k,
               *W0 = s->W0 + 3 * b, *rates0 = s->rates0 + m * b,
               *coupled = s->couplings + (size_t)3 * m * m * k;
  double Y[9], moved[9], C[9];
  summed(m, q1, E + 9, E, Y);
  summed(m, rates, E + 9, 0, moved);
  axial(moved, turning);
  const double trace = Y[0] + Y[4] + Y[8];
  for (int i = 0; i < 3; ++i)
    turning[i] += trace * W[i] - dot(3, Y + 3 * i, W);
  contracted(W, W0, C);
  for (int j = 0; j < m; ++j) {
    const double *e = E + 9 * (j + 1);
    double a[3];
    axial(e, a);
    double p = dot(3, a, W) + dot(m, s->D + m * (m * k + j), rates);
    double gradient = dot(9, half + 9 * (j + 1), C);
    for (int l = 0; l < m; ++l)
      for (int i = 0; i < 3; ++i)
        gradient += 0.5 * coupled[3 * (m * j + l) + i] * (rates0[l] * W[i] + rates[l] * W0[i]);
    out[j] = (p - s->p0[m * k + j]) / s->dt - gradient;
  }
}

/* Mean of the self-stress a of a body from q0 to q1, ½ q·V q less its value where it began; V q in
   the middle and at the end. */
static double self_stress(const struct shaped *s, int k, int a, struct told t, double *middle, double *end)
{
  const int m = s->m;
  const double *V = s->selves + (size_t)m * m * (s->self * k + a),
               *q0 = s->q0 + m * s->at[k], *q1 = t.q1 + m * k, *half = t.middle + m * k;
  double start = 0;
  for (int j = 0; j < m; ++j) {
    end[j] = dot(m, V + m * j, q1);
    middle[j] = dot(m, V + m * j, half);
    start += 0.5 * q0[j] * dot(m, V + m * j, q0);
  }
  return start + s->share * (0.5 * dot(m, q1, end) - start) - s->before[s->self * k + a];
}

/* Stresses Ω e + C Δe at the mean of e, and the forces on coordinates ∂e/∂q·s. */
static void elastic_of(const struct shaped *s, int k, struct told t, const double *dq,
                       double *work)
{
  const int m = s->m, b = s->at[k];
  const double *relieved = s->relieved ? s->relieved + (size_t)m * m * m * k : 0,
               *q1 = t.q1 + m * k;
  double *mean = work, *slope = work + m, *gained = t.de + m * k, *stress = t.stress + m * k,
         *elastic = t.elastic + m * k;
  if (relieved)
    slopes(m, relieved, q1, slope);
  for (int j = 0; j < m; ++j) {
    const double e0 = s->e0[m * b + j];
    double e = q1[j];
    if (relieved)
      e += 0.5 * dot(m, slope + m * j, q1) - s->shorter[m * k + j];
    gained[j] = relieved ? e - e0 : dq[j];
    mean[j] = e0 + s->share * gained[j];
  }
  for (int j = 0; j < m; ++j) {
    stress[j] = dot(m, s->stiffness + m * (m * k + j), mean);
    if (s->damping)
      stress[j] += dot(m, s->damping + m * (m * b + j), gained);
  }
  if (relieved)
    slopes(m, relieved, t.middle + m * k, slope);
  for (int j = 0; j < m; ++j) {
    elastic[j] = s->force[m * k + j] + stress[j];
    for (int l = 0; relieved && l < m; ++l)
      elastic[j] += slope[m * l + j] * stress[l];
  }
  for (int a = 0; a < s->self; ++a) {
    const double stress = self_stress(s, k, a, t, work, work + m);
    for (int j = 0; j < m; ++j)
      elastic[j] += stress * work[j];
  }
}

/* A trial, after `trial` of body_step.c has told what it knows: π₁, the displacements of all,
   (bodies, 4 + 3 m, 3), and the inertia forces, (bodies, 6 + m). */
void shaped_trial(const struct shaped *s, const double *rigid, const double *unknowns,
                  double *work, double *all, double *pi1, double *displacement, double *inertia)
{
  const int n = s->bodies, m = s->m, height = 4 + 3 * m;
  const double *theta = rigid, *R1s = theta + 12 * n, *six = R1s + 21 * n, *force = six + 12 * n;
  struct told t = told_of(s, all);
  for (int b = 0; b < n; ++b) {
    for (int i = 0; i < 3; ++i)
      pi1[3 * b + i] = R1s[18 * n + 3 * b + i];
    for (int i = 0; i < 3 * height; ++i)
      displacement[3 * height * b + i] = i < 12 ? six[12 * b + i] : 0;
    for (int i = 0; i < 6 + m; ++i)
      inertia[(6 + m) * b + i] = i < 6 ? force[6 * b + i] : 0;
  }
  for (int k = 0; k < s->some; ++k) {
    const int b = s->at[k];
    const double *pose = s->pose + 12 * b, *th = theta + 3 * b, *R1 = R1s + 9 * b,
                 *q0 = s->q0 + m * b, *dq = unknowns + (6 + m) * b + 6, *turn = six + 12 * b + 3;
    double *q1 = t.q1 + m * k, *W1 = t.W1 + 3 * k, *rates1 = t.rates1 + m * k,
           *E1 = t.E1 + 9 * (m + 1) * k, *half = t.half + 9 * (m + 1) * k, *S = t.S + 9 * k,
           *f = inertia + (6 + m) * b, *moved = displacement + 3 * height * b + 12;
    double R0[9], hat[9] = {0, -th[2], th[1], th[2], 0, -th[0], -th[1], th[0], 0};
    rotation(pose, R0);
    for (int j = 0; j < m; ++j) {
      q1[j] = q0[j] + dq[j];
      t.middle[m * k + j] = q0[j] + s->share * dq[j];
      rates1[j] = s->rate * dq[j] - s->rates0[m * b + j];
      for (int i = 0; i < 9; ++i)
        moved[9 * j + i] = dq[j] * R1[3 * (i % 3) + i / 3] + q0[j] * turn[i];
    }
    for (int i = 0; i < 3; ++i)
      W1[i] = s->rate * (R0[i] * th[0] + R0[3 + i] * th[1] + R0[6 + i] * th[2]) - s->W0[3 * b + i];
    product(hat, R0, S);
    for (int i = 0; i < 9; ++i)
      S[i] = s->share == 1 ? R1[i] : R0[i] + 0.5 * S[i];
    elastic_of(s, k, t, dq, work);
    /* E is linear in q: its mean is that in the middle. */
    const double *G = s->G + (size_t)9 * (m + 1) * (m + 1) * k, *E0 = s->E0 + 9 * (m + 1) * k;
    const int row = 9 * (m + 1);
    for (int i = 0; i < row; ++i) {
      double sum = G[i];
      for (int l = 0; l < m; ++l)
        sum += q1[l] * G[row * (l + 1) + i];
      E1[i] = sum;
      half[i] = 0.5 * (E0[i] + sum);
    }
    if (s->rate == 0)
      continue;
    double turning[3], own[3];
    inertia_of(s, k, t, turning, f + 6);
    for (int i = 0; i < 3; ++i)
      own[i] = dot(3, s->inertia + 9 * b + 3 * i, W1) + turning[i];
    image(R1, own, pi1 + 3 * b);
    for (int i = 0; i < 3; ++i)
      f[3 + i] = (pi1[3 * b + i] - s->spin[3 * b + i]) / (s->dt * s->length[b]);
    for (int j = 0; s->held[b] && j < m; ++j) {
      double d[3];
      image(S, s->drift + 3 * (m * b + j), d);
      f[6 + j] += dot(3, d, f);
    }
  }
}

/* Lᵀ without L, by moments of forces on nodes, shape (bodies, 4 + 3 m, 3). */
void shaped_resultant(const struct shaped *s, const double *rigid, double *all,
                      const double *moments, double *out)
{
  const int n = s->bodies, m = s->m, height = 12 + 9 * m;
  const double *R1s = rigid + 12 * n, *R_avs = R1s + 9 * n;
  struct told t = told_of(s, all);
  for (int b = 0; b < n; ++b) {
    const double *F = moments + height * b;
    double *f = out + (6 + m) * b, vf[9];
    product(R_avs + 9 * b, F + 3, vf);
    axial(vf, f + 3);
    for (int i = 0; i < 3; ++i) {
      f[i] = F[i];
      f[3 + i] /= s->length[b];
    }
    for (int j = 0; j < m; ++j)
      f[6 + j] = 0;
  }
  for (int k = 0; k < s->some; ++k) {
    const int b = s->at[k];
    const double *M = moments + height * b + 12, *S = t.S + 9 * k;
    double *f = out + (6 + m) * b, R0[9], ends[9], turned[9], couple[3];
    summed(m, t.q1 + m * k, M, 0, ends);
    product(R1s + 9 * b, ends, turned);
    if (s->share != 1) {
      double before[9];
      rotation(s->pose + 12 * b, R0);
      summed(m, s->q0 + m * b, M, 0, ends);
      product(R0, ends, before);
      for (int i = 0; i < 9; ++i)
        turned[i] = 0.5 * (turned[i] + before[i]);
    }
    axial(turned, couple);
    for (int i = 0; i < 3; ++i)
      f[3 + i] += couple[i] / s->length[b];
    for (int j = 0; j < m; ++j) {
      for (int i = 0; i < 9; ++i)
        f[6 + j] += M[9 * j + i] * S[3 * (i % 3) + i / 3];
      if (s->held[b]) {
        double d[3];
        image(S, s->drift + 3 * (m * b + j), d);
        f[6 + j] += dot(3, d, f);
      }
    }
  }
}

/* Rows of θ by θ and by q, rows of q by θ and by q, of the inertia of one body. */
static void inertia_blocks(const struct shaped *s, int k, struct told t, const double *R1,
                           double *turn, double *by_q, double *by_turn, double *own)
{
  const int m = s->m, b = s->at[k];
  const double *E1 = t.E1 + 9 * (m + 1) * k, *half = t.half + 9 * (m + 1) * k,
               *W1 = t.W1 + 3 * k, *W0 = s->W0 + 3 * b, *rates1 = t.rates1 + m * k,
               *rates0 = s->rates0 + m * b, *S = t.S + 9 * k, *drift = s->drift + 3 * m * b,
               *coupled = s->couplings + (size_t)3 * m * m * k,
               *G = s->G + (size_t)9 * (m + 1) * (m + 1) * k;
  const double rate = s->rate, dt = s->dt, both[3] = {W0[0] + W1[0], W0[1] + W1[1], W0[2] + W1[2]};
  double R0[9], Y[9], J[9], half_way[9], C[9];
  rotation(s->pose + 12 * b, R0);
  summed(m, t.q1 + m * k, E1 + 9, E1, Y);
  const double trace = Y[0] + Y[4] + Y[8];
  for (int i = 0; i < 9; ++i)
    J[i] = s->inertia[9 * b + i] - s->deformed[9 * b + i] + (i % 4 == 0) * trace - Y[i];
  product_by_transposed(J, R0, half_way);
  product(R1, half_way, turn);
  for (int i = 0; i < 9; ++i)
    turn[i] *= rate / dt;
  contracted(W1, W0, C);
  for (int j = 0; j < m; ++j) {
    const double *e = E1 + 9 * (j + 1), *h = half + 9 * (j + 1);
    const double e_trace = 2 * (e[0] + e[4] + e[8]), h_trace = 2 * (h[0] + h[4] + h[8]);
    double B[3], at_end[3], on_way[3], turned[3];
    axial(e, B);
    for (int i = 0; i < 3; ++i) {
      double now = rate * B[i] + e_trace * W1[i], then = h_trace * W0[i];
      for (int c = 0; c < 3; ++c) {
        now -= (e[3 * i + c] + e[3 * c + i]) * W1[c];
        then -= (h[3 * i + c] + h[3 * c + i]) * W0[c];
      }
      for (int l = 0; l < m; ++l) {
        now += coupled[3 * (m * j + l) + i] * rates1[l];
        then += coupled[3 * (m * j + l) + i] * rates0[l];
      }
      at_end[i] = now / dt;
      on_way[i] = rate * (B[i] / dt - 0.5 * then);
    }
    image(R1, at_end, turned);
    for (int i = 0; i < 3; ++i) {
      by_q[m * i + j] += turned[i];
      by_turn[3 * j + i] += dot(3, R0 + 3 * i, on_way);
    }
    for (int l = 0; l < m; ++l) {
      const double spun = dot(3, coupled + 3 * (m * j + l), both);
      own[m * j + l] += (rate * s->D[m * (m * k + j) + l] - spun) / dt -
                        0.5 * dot(9, G + 9 * ((m + 1) * (j + 1) + l + 1), C);
    }
    for (int l = 0; s->held[b] && l < m; ++l) {
      double of_row[3], of_column[3];
      image(S, drift + 3 * j, of_row);
      image(R1, drift + 3 * l, of_column);
      own[m * j + l] += rate / dt * s->mass[b] * dot(3, of_row, of_column);
    }
  }
}

/* Derivative of the elastic forces by q, of one body. */
static void elastic_blocks(const struct shaped *s, int k, struct told t, double *work, double *own)
{
  const int m = s->m, b = s->at[k];
  const double *Omega = s->stiffness + m * m * k, *stress = t.stress + m * k;
  for (int i = 0; i < m * m; ++i)
    own[i] = s->share * Omega[i] + (s->damping ? s->damping[m * m * b + i] : 0);
  if (!s->relieved)
    return;
  const double *relieved = s->relieved + (size_t)m * m * m * k;
  double *middle = work, *end = work + m * m, *left = work + 2 * m * m;
  slopes(m, relieved, t.middle + m * k, middle);
  slopes(m, relieved, t.q1 + m * k, end);
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < m; ++j) {
      double sum = own[m * i + j];
      for (int l = 0; l < m; ++l)
        sum += middle[m * l + i] * own[m * l + j];
      left[m * i + j] = sum;
    }
  for (int i = 0; i < m; ++i)
    for (int j = 0; j < m; ++j) {
      double sum = left[m * i + j];
      for (int l = 0; l < m; ++l)
        sum += left[m * i + l] * end[m * l + j] + s->share * stress[l] * relieved[m * (m * l + i) + j];
      own[m * i + j] = sum;
    }
  for (int a = 0; a < s->self; ++a) {
    const double *V = s->selves + (size_t)m * m * (s->self * k + a);
    const double stress = self_stress(s, k, a, t, middle, end);
    for (int i = 0; i < m; ++i)
      for (int j = 0; j < m; ++j)
        own[m * i + j] += s->share * (stress * V[m * i + j] + middle[i] * end[j]);
  }
}

/* Derivative of the residual that P does not carry, shape (bodies, 6 + m, 6 + m). */
void shaped_blocks(const struct shaped *s, const double *rigid, const double *pi1, double *work,
                   double *all, const double *moments, double *out)
{
  const int n = s->bodies, m = s->m, size = 6 + m, height = 12 + 9 * m;
  const double *Ts = rigid + 3 * n, *R1s = Ts + 9 * n, rates = 2 / (s->dt * s->dt);
  struct told t = told_of(s, all);
  for (int i = 0; i < n * size * size; ++i)
    out[i] = 0;
  for (int b = 0, k = 0; b < n; ++b) {
    const int shaped = k < s->some && s->at[k] == b;
    const double *T = Ts + 9 * b, *R1 = R1s + 9 * b, *F = moments + height * b + 3, *M = F + 9,
                 length = s->length[b];
    double *G = out + size * size * b, R0[9], v[9], couples[9], turn[9], gained[9] = {0};
    rotation(s->pose + 12 * b, R0);
    summed(shaped ? m : 0, t.q1 + m * k, M, F, v);
    product(R1, v, couples);
    const double trace = couples[0] + couples[4] + couples[8];
    for (int i = 0; i < 9; ++i)
      couples[i] = s->share * (couples[i] - (i % 4 == 0) * trace);
    if (s->rate != 0) {
      const double x = pi1[3 * b] / s->dt, y = pi1[3 * b + 1] / s->dt, z = pi1[3 * b + 2] / s->dt;
      const double hat[9] = {0, -z, y, z, 0, -x, -y, x, 0};
      double back[9];
      for (int i = 0; i < 9; ++i)
        couples[i] -= hat[i];
      product_by_transposed(s->deformed + 9 * b, R0, back);
      product(R1, back, gained);
      for (int i = 0; i < 3; ++i)
        G[size * i + i] = rates * s->mass[b];
    }
    product(couples, T, turn);
    for (int i = 0; i < 9; ++i)
      turn[i] += rates * gained[i];
    if (shaped) {
      double *by_q = work, *by_turn = by_q + 3 * m, *own = by_turn + 3 * m, *more = own + m * m;
      for (int j = 0; j < m; ++j) {
        double x[9], a[3], middle[3];
        product(R1, M + 9 * j, x);
        axial(x, a);
        product(R0, M + 9 * j, x);
        axial(x, middle);
        for (int i = 0; i < 3; ++i) {
          by_q[m * i + j] = s->share * a[i];
          by_turn[3 * j + i] = s->share == 1 ? a[0] * T[i] + a[1] * T[3 + i] + a[2] * T[6 + i]
                                             : 0.5 * middle[i];
        }
      }
      elastic_blocks(s, k, t, more, own);
      if (s->rate != 0) {
        inertia_blocks(s, k, t, R1, gained, by_q, by_turn, own);
        for (int i = 0; i < 9; ++i)
          turn[i] += gained[i];
      }
      for (int j = 0; j < m; ++j) {
        for (int i = 0; i < 3; ++i) {
          G[size * (3 + i) + 6 + j] = by_q[m * i + j] / length;
          G[size * (6 + j) + 3 + i] = by_turn[3 * j + i] / length;
        }
        for (int l = 0; l < m; ++l)
          G[size * (6 + j) + 6 + l] = own[m * j + l];
      }
      ++k;
    }
    for (int i = 0; i < 9; ++i)
      G[size * (3 + i / 3) + 3 + i % 3] = turn[i] / (length * length);
  }
}

/* -v̂/ℓ of the columns v of R, shape (9, 3): how a place that moves with them turns with ℓθ. */
static void levers(const double *R, double length, double *out)
{
  for (int j = 0; j < 3; ++j) {
    const double x = R[j] / length, y = R[3 + j] / length, z = R[6 + j] / length;
    const double arms[9] = {0, z, -y, -z, 0, x, y, -x, 0};
    for (int i = 0; i < 9; ++i)
      out[9 * j + i] = arms[i];
  }
}

/* L, or P at the end of the step, shape (bodies, 12 + 9 m, 6 + m). */
void shaped_follow(const struct shaped *s, const double *rigid, double *all, int end, double *out)
{
  const int n = s->bodies, m = s->m, size = 6 + m, height = 12 + 9 * m;
  const double *Ts = rigid + 3 * n, *R1s = Ts + 9 * n, *R_avs = R1s + 9 * n;
  struct told t = told_of(s, all);
  for (int i = 0; i < n * height * size; ++i)
    out[i] = 0;
  for (int b = 0, k = 0; b < n; ++b) {
    const double *R1 = R1s + 9 * b, *T = Ts + 9 * b;
    double *rows = out + (size_t)height * size * b, R0[9], at_mean[27], at_start[27], at_end[27];
    rotation(s->pose + 12 * b, R0);
    levers(R_avs + 9 * b, s->length[b], at_mean);
    levers(R0, s->length[b], at_start);
    levers(R1, s->length[b], at_end);
    if (end || s->share == 1)
      for (int c = 0; c < 27; ++c)
        at_mean[c] = at_end[c];
    const int shaped = k < s->some && s->at[k] == b;
    for (int j = 0; j <= (shaped ? m : 0); ++j)
      for (int c = 0; c < 9; ++c) {
        double turned[3], *row = rows + size * (3 + 9 * j + c) + 3;
        for (int i = 0; i < 3; ++i) {
          turned[i] = at_mean[3 * c + i];
          if (j) {
            const double q0 = s->q0[m * b + j - 1], q1 = t.q1[m * k + j - 1];
            turned[i] = end || s->share == 1
                            ? q1 * at_end[3 * c + i]
                            : 0.5 * q0 * at_start[3 * c + i] + 0.5 * q1 * at_end[3 * c + i];
          }
        }
        for (int i = 0; i < 3; ++i)
          row[i] = end ? turned[0] * T[i] + turned[1] * T[3 + i] + turned[2] * T[6 + i] : turned[i];
      }
    for (int i = 0; i < 3; ++i)
      rows[size * i + i] = 1;
    if (!shaped)
      continue;
    const double *S = end ? R1 : t.S + 9 * k;
    for (int j = 0; j < s->counts[b]; ++j) {
      double d[3];
      image(S, s->drift + 3 * (m * b + j), d);
      for (int i = 0; i < 3; ++i)
        rows[size * i + 6 + j] = d[i];
      for (int i = 0; i < 9; ++i)
        rows[size * (12 + 9 * j + i) + 6 + j] = S[3 * (i % 3) + i / 3];
    }
    ++k;
  }
}
