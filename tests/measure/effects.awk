# The page docs/effects.md from what effects.c prints: of each effect its setting, passes and time; tables of settings
# that are not needed are left out, and the sentences about them stay.
BEGIN { FS = " *[|] *" }
/^## / { unneeded = /not needed/ }
unneeded && /^[|]/ { next }
/^[|]-/ { print "|---|---|---|---|"; next }
/^[|]/ && NF > 8 { print "| " $2 " | " $3 " | " $4 " | " $(NF - 1) " |"; next }
{ print }
