"""Maps and what is made of them: cells over time, costs, work area, margin."""
