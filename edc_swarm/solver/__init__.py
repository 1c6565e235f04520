"""The slot QP: problem in, solution with residuals out, certificate last."""
