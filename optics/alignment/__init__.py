"""How the mirrors of a device are turned from their design, told from pictures of any scene, without a board."""
