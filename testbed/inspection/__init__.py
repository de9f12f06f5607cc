"""Plant validation: experiments on the plant with known results."""
