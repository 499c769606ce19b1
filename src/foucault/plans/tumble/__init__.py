"""How a torqued cluster is turned, within what its rig allows."""
