"""Jobs of dpr-lab, one per file: from files to results, with typed progress events.

Command line, screen, demo, trials and notebooks use these jobs. A job is a function

    job(request, on_event) -> result

A request is frozen and contains file names and options. A job writes the files that its request names, reports progress
to `on_event` (`workflows.events`), and never prints. Its callers display events and result; they parse no text.
Importing a job is fast, because it imports large libraries only when it runs. The process that draws a screen can
therefore refer to jobs that another process executes.
"""
