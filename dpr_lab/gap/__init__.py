"""Diagnosis of the gap between simulation and rig: size, location, causes, probabilities, reduction.

`diagnose.diagnose` runs the stages; each stage returns a frozen record of `state`.

    stage (reported as)        entry point                       question
    screen                     screen.record.record              which readings are faulty?
    bare model                 bare_model.fit_bare_model         what remains without effects?
    where                      where.locate.locate               at which angle, speed or time does it remain?
    which                      which.select.forward              which sets of effects explain it?
                               corrections.corrected             do the recordings need a correction?
                               which.select.refined              which set is the simplest explanation?
    classes                    classes.posterior.effect_posterior  which effects are indistinguishable, how probable?
    transfer                   transfer.transfer.transfer        does the set predict recordings that were not fitted?
    advice                     advice.advise.advise              which check separates the alternatives?
    evidence                   evidence.evidence.evidence        what supports the result?
    conclusion                 conclusion.conclusion.conclude    verdict, intervals, assumptions

Why was cause X preferred to Y? The field `search` of a diagnosis lists all trials of the search. The trial that rejects
Y, or that replaces Y by X, states its move and the reason.

Reading order. The rules by which sets of effects are compared are in modules of about 9,500 words:

    `hypothesis.hypothesis`      the cost, by which sets are compared
    `hypothesis.thresholds`      the numbers in the rules
    `hypothesis.significance`    the difference of cost that counts
    `hypothesis.imitation`       effects that only fit the residual of other causes
    `which.search`               a move, which proposes sets, accepts or rejects them, and states the reason
    `which.moves`                the order of the moves
    `which.forward`              the moves; a trial states the name of its move
    `which.removals`
    `which.replacements`
    `classes.posterior`          the probabilities of X and Y, if both remain

The stages are in modules of about 7,400 words: `state`, `diagnose`, `bare_model`, `hypothesis.score_test`,
`which.select`, `corrections`, `transfer.transfer`, `conclusion.verdict`. The other modules contain about 77,000 words.
Each contains the computations of one decision; read it when you change it. Two parts belong to no single stage:
`damage` (outliers, kicks and rods moved by a hand, which the fit of the bare model excludes, and steps of a reading)
and `films` (corrections of films).

Terms of all modules:

    bare model        ratios and initial states without effects of the library; `bare` in all arguments
    hypothesis        a set of effects with its fit (`hypothesis.hypothesis.Hypothesis`)
    score             predicted reduction of chi2 by one more effect, from one linearised fit
    cost, criterion   held-out chi-square plus the penalty of the parameters, by which sets are compared
    excess            chi2 above the noise; `bounded_excess` is at least the random variation of the noise
    remainder         residual above the noise that a set of effects leaves
    inflation         variance inflation n / n_eff: chi2 that corresponds to one independent reading
    curve             an effect of three or more amplitudes, which can imitate a sum of other effects
    form              an effect that contains a simpler one (`Effect.nested`) as a special case is a richer form of it
    expected, known   effects that the rig file implies, for example of a geared motor; all others are `unexpected`
    universal         effects that every rig has, for example a zero error of an encoder
    common            effects that are visible on most rigs: the universal ones, base tilt, Coulomb friction, air drag
    own share         unique contribution: part of an effect's reduction of chi2 that no form of the others explains
    possible          physically feasible: a set whose sizes and gravity torque a rig can have
    shape             values of the nonlinear parameters of an effect, for example of its order, frequency or instant
    held out          not fitted: `Request.held_out` contains the runs, `Fitted.held_out` the screened runs

docs/how-the-diagnosis-decides.md explains the decisions; docs/theory.md, sections 5 and 7 to 10, contains the
equations.
"""
