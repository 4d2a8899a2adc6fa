"""Effects: each is whole in one declaration, with its law, its slot, its starts and its sentence."""
