"""From a force map to a verdict: limits, criteria, speed advice, probabilities, grinding."""
