"""Latin hypercube sampling: an initial population that covers the range of every gene evenly."""

import numpy as np

from dpr_lab.search.population import Population, ranked
from dpr_lab.search.problem import SearchProblem


def latin_hypercube(problem: SearchProblem, size: int, rng: np.random.Generator) -> Population:
    """Draw a population by Latin hypercube sampling, the best individual first.

    The range of each gene is divided into `size` equal intervals. Each interval contains exactly one individual.

    Source: McKay, Beckman & Conover (1979), Technometrics 21(2), 239-245.
    """
    from scipy.stats.qmc import LatinHypercube  # slow to import

    lower, upper = problem.box
    shares = LatinHypercube(len(lower), rng=rng).random(size)
    genes = np.clip(lower + shares * (upper - lower), lower, upper)
    return ranked(genes, problem.costs(genes))
