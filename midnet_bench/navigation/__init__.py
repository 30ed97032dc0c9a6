"""How a robot gets around: layered costmaps, navfn, two local planners, a move_base-like navigator."""
