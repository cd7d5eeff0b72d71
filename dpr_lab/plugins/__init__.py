"""Plugins: entry points by which installed packages add rows to the tables of dpr-lab.

    group                object                                                  name of the entry point
    dpr_lab.effects      `dpr_lab.effects.effect.Effect`, or several             any
    dpr_lab.readers      `dpr_lab.storage.readers.Reader`                        any
    dpr_lab.transports   `dpr_lab.transports.LinkKind`                           scheme of the URL
    dpr_lab.searches     `dpr_lab.search.algorithm.Algorithm`                    `algorithm` of a search file
    dpr_lab.exports      `dpr_lab.exports.ExportFormat`                          name of the format

Only installed packages are plugins. A package in the current folder is not a plugin, and a module in this folder cannot
replace a plugin. A plugin that cannot be used is skipped, and `skipped` states the reason. The environment variable
`DPR_LAB_NO_PLUGINS` disables all plugins, in this process and in the processes that it starts.

Source: entry points of the Python Packaging Authority, https://packaging.python.org/specifications/entry-points/.
"""
