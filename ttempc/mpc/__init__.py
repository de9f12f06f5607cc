"""Linear model predictive control: error model, QP, solver."""
