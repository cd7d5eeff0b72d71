"""The jobs of the lab, one in a file: files in, results out, typed events on the way.

Command line, bench screen, demo, trials and notebooks are shells over these. A job is a function

    job(request, on_event) -> result

of a frozen request that holds file names and options. It writes the files that the request names, tells `on_event`
how far it is (`workflows.events`) and never prints. What a shell shows it takes from events and result; it parses no
text. Importing a job is cheap: what is heavy is imported when it runs, so that the process that draws a screen can
name jobs that another process carries out.
"""
