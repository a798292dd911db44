"""From a force map to a verdict: limits, criteria, speed advice, probabilities, grinding; `judge` composes all of it."""
