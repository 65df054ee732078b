"""What a client that streams by view wants to know of a file: tight boxes, and what each layer of a tile gains."""
