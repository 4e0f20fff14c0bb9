"""How long the method takes, beside others that do the same: what `lrtrav benchmark` measures, writes and draws."""
