/* A trial step of rigid bodies, one after another: see body_step.py, which has the equations.

   Matrices are stored row by row; every array begins with an axis over the bodies. */

static void product(const double *A, const double *B, double *C)
{
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

static void image(const double *A, const double *x, double *y)
{
  for (int i = 0; i < 3; ++i)
    y[i] = A[3 * i] * x[0] + A[3 * i + 1] * x[1] + A[3 * i + 2] * x[2];
}

/* What moves with a trial, and the inertia forces. `pose` has the rows r and R0ᵀ, `velocity` ṙ0,
   `own` J W0 and `spin` π0, `six` the unknowns Δr and ℓθ; `out` is for what is named first below. */
void trial(int bodies, double dt, const double *mass, const double *inertia, const double *length,
           const double *pose, const double *velocity, const double *own, const double *spin,
           const double *six, double *out)
{
  double *theta = out, *T = theta + 3 * bodies, *R1 = T + 9 * bodies, *R_av = R1 + 9 * bodies,
         *pi1 = R_av + 9 * bodies, *displacement = pi1 + 3 * bodies,
         *force = displacement + 12 * bodies;
  for (int b = 0; b < bodies; ++b) {
    const double *J = inertia + 9 * b, *at = pose + 12 * b, *y = six + 6 * b;
    double *th = theta + 3 * b, *t = T + 9 * b, *d = displacement + 12 * b, *f = force + 6 * b;
    double R0[9], spread[9], turn[9], gained[3], own_frame[3], turned[3];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j)
        R0[3 * i + j] = at[3 + 3 * j + i];
    for (int i = 0; i < 3; ++i)
      th[i] = y[3 + i] / length[b];
    const double a = 0.5 * th[0], c = 0.5 * th[1], e = 0.5 * th[2];
    const double half[9] = {0, -e, c, e, 0, -a, -c, a, 0};
    const double less = 1 + 0.25 * (th[0] * th[0] + th[1] * th[1] + th[2] * th[2]);
    for (int i = 0; i < 9; ++i)
      t[i] = ((i % 4 == 0) + half[i]) / less;
    /* R1 - R0 = θ̂ T R0, as cay(θ) = I + θ̂ T */
    product(t, R0, spread);
    product(half, spread, turn);
    for (int i = 0; i < 9; ++i) {
      turn[i] *= 2;
      R1[9 * b + i] = R0[i] + turn[i];
      R_av[9 * b + i] = R0[i] + 0.5 * turn[i];
    }
    for (int i = 0; i < 3; ++i) {
      d[i] = y[i];
      for (int j = 0; j < 3; ++j)
        d[3 + 3 * j + i] = turn[3 * i + j];
    }
    /* J W1 = 2 J R0ᵀθ/Δt - J W0 */
    for (int i = 0; i < 3; ++i)
      own_frame[i] = (R0[i] * th[0] + R0[3 + i] * th[1] + R0[6 + i] * th[2]) * 2 / dt;
    image(J, own_frame, gained);
    for (int i = 0; i < 3; ++i)
      gained[i] -= own[3 * b + i];
    image(R1 + 9 * b, gained, turned);
    for (int i = 0; i < 3; ++i) {
      pi1[3 * b + i] = turned[i];
      f[i] = 2 / (dt * dt) * mass[b] * (y[i] - dt * velocity[3 * b + i]);
      f[3 + i] = (turned[i] - spin[3 * b + i]) / (dt * length[b]);
    }
  }
}

/* Σ f and Σ v_av × f/ℓ from Σ f and Σ V fᵀ, after a trial that has told so. */
void resultant(int bodies, const double *length, const double *told, const double *moments,
               double *out)
{
  const double *R_av = told + (3 + 9 + 9) * bodies;
  for (int b = 0; b < bodies; ++b) {
    const double *m = moments + 12 * b;
    double vf[9];
    product(R_av + 9 * b, m + 3, vf);
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3, k = (i + 2) % 3;
      out[6 * b + i] = m[i];
      out[6 * b + 3 + i] = (vf[3 * j + k] - vf[3 * k + j]) / length[b];
    }
  }
}

/* Residual of the bodies: what `resultant` gives, with the inertia forces of that trial and less
   torques/ℓ. */
void balance(int bodies, const double *length, const double *told, const double *moments,
             const double *torques, double *out)
{
  const double *force = told + (3 + 9 + 9 + 9 + 3 + 12) * bodies;
  resultant(bodies, length, told, moments, out);
  for (int b = 0; b < bodies; ++b)
    for (int i = 0; i < 3; ++i) {
      out[6 * b + i] += force[6 * b + i];
      out[6 * b + 3 + i] += force[6 * b + 3 + i] - torques[3 * b + i] / length[b];
    }
}
