"""What the pages cite, each once."""

PAPER = "“The use of a digital twin to reconfigure a nonlinear internal model controller”"
INTEGRATOR = "Cox and Matthews, J. Comput. Phys. 176 (2002) 430"
SHARES = "Wilson, J. Am. Stat. Assoc. 22 (1927) 209; Newcombe, Statistics in Medicine 17 (1998) 857"
