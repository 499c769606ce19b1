"""A calibration certificate by ISO/IEC 17025, for people (PDF/A-3) and for programs (DCC).

What a certificate says is one model (`content.Certificate`), made of a run folder, of what people
write (`said`) and of the records. From that alone come the page (`pdf`, in words of `labels`) and
the Digital Calibration Certificate (`dcc`), which is kept inside the page as well as beside it.
`signature` signs both with the laboratory's own key, and `verify` looks at what somebody has got.
The same content makes the same bytes. Libraries are loaded where they are used.
"""
