"""Pictures of the documentation: ``python -m pictures`` draws them all, ``python -m pictures NAME`` some of them."""
