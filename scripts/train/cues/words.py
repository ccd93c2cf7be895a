"""What is said: the cues in several pronunciations, words that sound like them, other words, sentences."""

LABELS = ("forward", "left", "right", "stop", "go", "other")
CUES = LABELS[:5]
# Of *go* there are 232 real clips: synthetic voices say it no more often than other words.
SYNTHETIC_CUES = CUES[:4]

# Pronunciations in IPA for voices that read phonemes. The first are the dictionary's, American and British; the
# others are what speakers of other first languages make of them: a dropped or unvoiced end, a flat vowel, a rolled r.
PRONUNCIATIONS: dict[str, tuple[str, ...]] = {
    "forward": (
        "fˈɔːɹwɚd",
        "fˈɔːwəd",
        "fˈɔːɹwɚt",
        "fˈoːɹwɔɹd",
        "fˈɔːwɔːd",
        "fˈɔɾwaɾd",
        "fˈɔːvɚd",
        "fˈɔːʋəd",
        "fˈoʊwɚd",
    ),
    "left": ("lˈɛft", "lˈɛft", "lˈɛf", "lˈeft", "lˈæft", "lˈɛːft", "lˈɛftə", "lˈef", "lˈɛfʰt", "ɾˈɛft"),
    "right": ("ɹˈaɪt", "ɹˈaɪt", "ɹˈaɪtʰ", "rˈaɪt", "ɹˈʌɪt", "ɹˈɔɪt", "ɹˈaːt", "ɾˈaɪt", "ɹˈaɪ"),
    "stop": ("stˈɑːp", "stˈɒp", "stˈɔp", "stˈʌp", "əstˈɔp", "stˈap", "stˈɑːpʰ", "ʃtˈɔp", "stˈoːp"),
}

# In the mnemonics of eSpeak NG, to be read with the sounds of another language: its r, its vowels, its consonants.
ACCENTED: dict[str, tuple[str, ...]] = {
    "forward": ("f'OrwOrd", "f'orword", "f'O:wOd", "f'OrvOrd", "f'Orwart", "f'o:wod", "f'Orwad"),
    "left": ("l'Eft", "l'eft", "l'Ef", "l'ef", "l'aft", "l'Eftt", "l'eftt"),
    "right": ("r'ait", "r'aitt", "r'ai", "r'aIt", "R'ait", "r'a:it"),
    "stop": ("st'Op", "st'op", "st'ap", "st'a:p", "st'Opp", "est'op", "st'O:p"),
    "four": ("f'O:", "f'Or", "f'or", "f'o:"),
    "forty": ("f'Orti",),
    "for": ("f'Or",),
    "world": ("w'Orld",),
    "word": ("w'Ord",),
    "lift": ("l'ift",),
    "laugh": ("l'af", "l'Of"),
    "life": ("l'aif",),
    "let": ("l'Et", "l'et"),
    "light": ("l'ait",),
    "leg": ("l'eg",),
    "ride": ("r'aid",),
    "rat": ("r'at", "r'et"),
    "rain": ("r'ein",),
    "night": ("n'ait",),
    "why": ("w'ai",),
    "step": ("st'ep",),
    "top": ("t'op", "t'Op"),
    "shop": ("S'op", "S'Op"),
    "star": ("st'ar", "st'a:"),
    "spot": ("sp'ot",),
    "dog": ("d'Og", "d'og"),
    "off": ("'Of",),
    "up": ("'ap",),
    "on": ("'On",),
    "one": ("w'an", "u'an"),
    "two": ("t'u", "t'u:"),
    "three": ("tr'i", "sr'i"),
    "five": ("f'aiv", "f'aif"),
    "front": ("fr'ant",),
    "back": ("b'ak", "b'Ek"),
    "none": ("n'an", "n'On"),
    "no": ("n'o", "n'ou"),
    "go": ("g'o", "g'ou"),
    "yes": ("j'es", "j'Es"),
    "hello": ("hel'o",),
    "good": ("g'ud",),
    "please": ("pl'is",),
    "okay": ("ok'ei",),
}

SOUND_ALIKES: dict[str, tuple[str, ...]] = {
    "forward": tuple(
        "four for fore ford fort form force fourth forty foreword afford award reward toward coward wayward awkward "
        "hardware board ward word world fourteen forever forget forest former formal fortune format forehead foul "
        "fowl flower forked forced forager wood would warden chord cord lord sword floor door more power far first "
        "follow fall fault fog fox phone".split()
    ),
    "left": tuple(
        "lift laughed loft leaf let led leg less lest lent lend theft cleft deft drift raft length "
        "lexus electric elf self shelf deaf chef loved leapt lapped lap level lemon letter leather "
        "cliff leave live life like look lost last laughs".split()
    ),
    "right": tuple(
        "ride rice rise ripe rhyme light fright bright height night tight kite bite fight sight white rate rat "
        "rot root route wrote read red road ring rain run rye rile riot rider tribe trite price pride try dry cry why "
        "lied line lie like life around round rack rock mite might".split()
    ),
    "stop": tuple(
        "stoop step stock stomp strop stab staff star start stuff stub stump top tops shop chop hop drop crop prop "
        "swap spot stood stone stow stay steep stalk stall storm stork still stick stack sob sop slop flop "
        "cop mop pop up off dog dawn odd on job stupid store staple laptop bottom talk tock doc".split()
    ),
}

# Everyday words, digits and letters of the alphabet, other commands and names.
OTHER_WORDS: tuple[str, ...] = tuple(
    "bed bird cat dog down eight five four happy house marvin nine no off on one seven sheila six three tree two up "
    "wow yes zero back front none ten eleven twelve twenty thirty hundred thousand backward behind ahead straight turn "
    "halt wait pause slow fast quick walk come here there away near far home kitchen table chair window wall stairs "
    "elevator lift station train bus taxi street corner crossing bridge park shop market office doctor nurse water "
    "coffee tea bread milk apple orange banana sugar pepper money ticket number letter paper pencil computer phone "
    "music radio television camera picture movie game ball football guitar piano summer winter spring autumn monday "
    "tuesday wednesday thursday friday saturday sunday morning evening afternoon midnight yesterday today tomorrow "
    "minute hour second week month year mother father brother sister uncle daughter baby friend teacher student "
    "police fire engine hello goodbye please thanks sorry okay maybe never always often sometimes good bad big small "
    "long short high low hot cold warm wet dry new old young happy sad angry tired hungry ready open close push pull "
    "give take make bring carry hold drop catch throw sit stand lie sleep wake eat drink read speak listen hear see "
    "watch find lose keep leave stay follow guide robot battery sensor laser motor leg foot hand arm head eye ear nose "
    "mouth hair face body heart black white red green blue yellow brown purple silver gold circle square triangle "
    "animal horse cow sheep pig chicken duck fish mouse rabbit lion tiger bear elephant monkey snake spider flower "
    "grass garden river lake ocean mountain forest desert island beach city village country world planet moon sun star "
    "cloud rain snow wind storm thunder weather problem question answer reason idea story book page word sentence "
    "language english french german spanish chinese japanese alpha bravo charlie delta echo foxtrot golf hotel india "
    "juliet kilo lima mike november oscar papa quebec romeo sierra tango uniform victor whiskey zulu ah oh um hey "
    "huh hmm aha oops ouch yeah yep nope well so and but because then what who where when how which a b c d e f g h i "
    "j k l m n o p q r s t u v w x y z".split()
)

SENTENCES: tuple[str, ...] = (
    "good morning, how are you today",
    "the weather is going to be nice this weekend",
    "could you tell me what time it is",
    "I have to go to the supermarket after work",
    "my sister lives in another town",
    "the meeting starts at nine o'clock",
    "do you want some coffee",
    "he bought a new bicycle yesterday",
    "we should call the doctor tomorrow",
    "she is reading a long book about history",
    "the train to the airport leaves in ten minutes",
    "where is the nearest pharmacy",
    "I think that it is going to rain",
    "please close the window",
    "there is a big dog in the garden",
    "they are building a new school over there",
    "the kids are playing football",
    "what do you want for dinner",
    "open the door for me please",
    "it costs fourteen dollars and fifty cents",
    "my phone number is four four five six",
    "he told me the whole story last night",
    "the shop is closed on Sundays",
    "can you hear the music",
    "I lost my keys somewhere in the house",
    "we walked along the river for hours",
    "that was a wonderful concert",
    "the elevator is out of order",
    "let me know when you are ready",
    "nobody knows what happened after that",
    "it takes about half an hour by bus",
    "this coat is too small for me",
    "the cat is sleeping on the sofa",
    "turn the radio down a little",
    "I would like a glass of water",
    "they laughed at the old joke",
    "the storm destroyed the roof of the barn",
    "a light in the night",
    "it is a long and narrow road",
    "put the boxes on the top shelf",
    "he stood in front of the shop",
    "the price of bread went up again",
    "I am afraid of spiders",
    "we are looking for room number four hundred",
    "the stock market fell today",
    "look at the stars above the mountain",
    "wait for me at the corner",
    "who is going to pay for all this",
    "the flowers need some water",
    "she wrote a letter to her uncle",
    "hold my hand when we cross the street",
    "be careful, the floor is wet",
    "there are two chairs next to the table",
    "thank you very much for your help",
    "see you later",
    "have a nice day",
    "excuse me",
    "no problem at all",
    "oh my god",
    "come on let's go",
    "all of them",
    "I don't know",
    "of course not",
    "what a lovely surprise",
    "happy birthday to you",
    "once upon a time",
    "the robot walks slowly along the hallway",
    "its battery is almost empty",
    "a chair is in the way",
    "sit down please",
    "good dog",
    "nice and easy",
    "that's enough for now",
    "give me the ball",
    "who let the dogs out",
    "the first step is the hardest",
    "go back home",
    "slow down a bit",
    "keep walking",
    "come here",
    "over there",
    "the lift goes up to the fourth floor",
    "the office is on the top floor",
    "this is the fourth word on the board",
    "people from all over the world came to watch",
    "he laughed and lifted the leather bag",
)

# Of these, of the sound-alikes and of the other words is talk made that means nothing: a television that never repeats itself.
COMMON: tuple[str, ...] = tuple(
    "the a an of to in for on with at by from about into over after under between through during before without "
    "against until since is are was were has have had will would can could should may might must do does did not "
    "he she it we they you I his her our their your my this that these those there here some any all both each few "
    "more most other such only own same than too very just now again once also even still already almost perhaps "
    "people man woman child family house home school city country state government president minister party law court "
    "police officer army soldier war peace attack victim prison crime report news story newspaper programme film actor "
    "music song concert album band show ticket stage audience winner prize award medal champion team player coach match "
    "goal score season league stadium race record company business market bank price cost profit loss budget tax pound "
    "dollar euro share stock office factory worker job boss union contract project product customer service quality "
    "science scientist study research university professor student discovery species planet rocket engine machine "
    "computer network software phone data energy oil gas coal power climate weather temperature forecast storm frost "
    "flood fire smoke earthquake accident hospital doctor nurse patient drug medicine vaccine disease heart blood "
    "kitchen recipe pot pan oven butter onion garlic tomato sauce soft cloth coffee chocolate bottle glass plate spoon "
    "knife table sofa carpet curtain garden roof wall window door lock clock box bag coat shoe sock cotton colour "
    "strong weak heavy light dark bright broad narrow wide deep shallow early late quick slow cheap expensive modern "
    "ancient famous popular common rare simple difficult important serious dangerous healthy honest polite proud brave "
    "said told asked answered announced reported explained promised refused agreed decided started finished opened "
    "closed continued changed increased rose fell dropped lifted crossed followed arrived returned escaped survived "
    "bought sold paid spent saved lost won found caught brought taught thought fought wrote spoke broke chose drove "
    "rising prices rights higher fire wires tired island silent violent private pilot tribal widely writing exciting "
    "across along around behind beside beyond toward towards upward afterward straightforward forwarded leftover "
    "stopped stopping stopover bystander steps studio stomach stocking stockholm costly crops topics options copies "
    "probably possible problemprofit economic electronic politics policy comic tropical octopus october hospital "
    "fourteen fortune fortnight formal former forgot forgotten forever performance important sport report support "
    "lift lifts lifting laughing laughter leftist cleverly elephant elegant relevant level leaves leading legal "
    "going goes gold golden goal goat ghost coast boat road load broke alone ago echo hotel Tokyo Mexico".split()
)

# What a handler's cues are most easily taken for; each is judged by itself.
TEST_ALIKES: tuple[str, ...] = tuple("start lift drop dog follow place shop top fort write laugh step no low".split())

# What a television says where it is judged: none of it trains, and no word of it is a cue.
BROADCASTS: tuple[str, ...] = (
    "the government has announced new measures against rising prices",
    "and now over to our reporter in the capital",
    "more than two thousand people took part in the march",
    "the match ended in a draw after extra time",
    "tonight we expect heavy showers along the western coast",
    "temperatures will reach nineteen degrees in the afternoon",
    "call now and save fifty percent on your first order",
    "the new model is faster, lighter and more comfortable",
    "police are looking for witnesses of the accident",
    "scientists have discovered a new kind of frog in the rainforest",
    "our next guest needs no introduction",
    "the talks between both countries will continue on Thursday",
    "he was taken to hospital with minor injuries",
    "shares closed four percent lower in Frankfurt",
    "add the onions and cook them until they are soft",
    "this programme was brought to you by our sponsors",
    "she won the gold medal in the hundred metres",
    "the film opens in cinemas next weekend",
    "you are watching the evening news",
    "I told you that he would never come home",
    "what have you done with the money, Laura",
    "the suspect drove off in a dark blue car",
    "nobody leaves this room until we know the truth",
    "after the break we will be talking to the coach",
    "the river rose by almost three metres overnight",
    "drop by our shop in the town centre",
    "a fourth of the crop was lost to the frost",
    "they lifted the wreck from the bottom of the lake",
    "start your day with a bowl of golden flakes",
    "follow the story on our website",
)

# Said in one breath as a handler might: a cue all the same. The word that counts stands at the end.
STOP_PHRASES: tuple[str, ...] = ("stop, stop", "please stop", "hey, stop", "no, stop", "okay stop")
