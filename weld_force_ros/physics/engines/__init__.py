"""Three representations of the track in time: common poles, rational fractions, moving Green's functions."""
