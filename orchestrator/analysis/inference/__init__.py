"""How cells are paired, crossed and compared many times: on arrays and data frames, knowing nothing of groups."""
