"""A wheel's passage over a weld in time: state space, Hertz contact, compiled loops."""
