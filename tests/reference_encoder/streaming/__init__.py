"""What files tell clients: viewpoints, errors after each layer, gains, boxes."""
