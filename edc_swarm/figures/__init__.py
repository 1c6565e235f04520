"""The figures of the paper's section IV, and of the energy bill: what each is, and what it shows."""
