"""The measurement graph as a model: places, transitions, firing order, all trials at once."""
