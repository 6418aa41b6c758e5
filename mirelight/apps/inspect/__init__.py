"""`mirelight inspect`: what a file holds, told without rendering anything."""
