"""Where trials happen: floor plans, placement, free space, and the prior maps that come with the package."""
