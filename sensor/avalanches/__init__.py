"""How effects act on each other in time: avalanches simulated, counts drawn, their moments."""
