"""True labels as annotation tools write them."""
