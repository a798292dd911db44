"""From what an instrument wrote to a `WeldProfile`, and measurements made up for trials."""
